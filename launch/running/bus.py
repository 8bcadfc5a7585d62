"""The sockets of a worker process: orders in, reports out, one outlet for the nodes of the graph, one for observers.

A frame of ZeroMQ is the stream's name, a zero byte, and the message as one msgpack map. The outlets are publishers, so
that any program can subscribe by the stream's name. Observers have an outlet of their own: frames for them are kept
back and sent in bursts, because waking a second reader costs 60-100 us, which the force path must not pay.

On the simulated clock an outlet waits when a reader is slow; on the real clock it drops, and the reader counts. An
outlet is closed when its readers have taken all: what a connection holds when its other end closes is lost to a reader
that had no room for it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable

import msgspec
import zmq

from palpate.launch.running.addresses import endpoint
from palpate.launch.running.carrier import HIGH_WATER, LOOK, Inlet, LocalInlet, LocalOutlet, Pairs, ZmqInlet, ZmqOutlet
from palpate.launch.running.keys import Keeper, Key, connect
from palpate.launch.running.reports import ORDERS, Addressed, Order, Report
from palpate.physics.errors import PalpateError

HEALTH = "!health"
"""Stream of each outlet for observers on which its worker tells how the nodes are doing."""
END = "!end"
"""Stream of each outlet for observers on which its worker says last that it sends no more; the payload is its group."""
LONGEST_ORDER = 1 << 26  # [bytes]


class PortInUse(PalpateError, OSError):
    """An endpoint that another program has bound."""


def frame(stream: str, payload: bytes) -> bytes:
    """The frame of a message on a stream."""
    return stream.encode() + b"\0" + payload


def split(data: bytes) -> tuple[str, bytes]:
    """Stream and payload of a frame. ValueError: no zero byte, or a name that is not UTF-8."""
    topic, zero, payload = data.partition(b"\0")
    if not zero:
        raise ValueError(f"not a frame: no zero byte among {len(data)} bytes")
    return topic.decode(), payload


class Bus:
    """Sockets of one worker.

    run, group  names of the run and of the worker
    control     endpoint of the launcher's control publisher
    reports     endpoint where the launcher takes reports
    real        whether it is the real clock: nobody waits for a slow reader
    wait        [ms] after which an inlet gives up waiting once, so that the caller can look round
    pairs       of the local carrier, as far as they begin or end here
    key         secures the outlets where they are bound to TCP as well; None: nothing is secured
    guarded     the launcher's sockets are secured by the key
    """

    def __init__(
        self,
        run: str,
        group: str,
        control: str,
        reports: str,
        real: bool,
        wait: int = LOOK,
        pairs: Pairs | None = None,
        key: Key | None = None,
        guarded: bool = False,
    ) -> None:
        self.context = zmq.Context()
        self.run, self.group, self.real, self.wait, self.key = run, group, real, wait, key
        self.foreign = 0
        """Frames that were dropped because they are none of this run's."""
        self._pairs = pairs or {}
        self._keeper: Keeper | None = None
        self._control = self._socket(zmq.SUB, 0)
        self._control.set(zmq.MAXMSGSIZE, LONGEST_ORDER)
        self._reports = self._socket(zmq.PUSH, 2000)
        for socket, address in ((self._control, control), (self._reports, reports)):
            connect(socket, address, key if guarded else None)
        for topic in (f"~{group}", "~*"):
            self._control.subscribe(topic.encode() + b"\0")
        # What the outlets hold is delivered, however long it takes: the launcher ends those who never read it.
        self._force = self._outlet()
        self._observers = self._outlet()
        self._observed = self._socket(zmq.SUB, 0)
        self._observed.set(zmq.RCVHWM, HIGH_WATER)
        self._observed.set(zmq.RCVTIMEO, wait)
        self._inlets: dict[str, Inlet] = {}
        self.listeners: dict[bytes, int] = {}
        self._readers = 0
        """Inlets of the nodes elsewhere that read here."""
        self._sources: dict[str, str] = {}
        """Endpoint of each group that is observed here."""
        self._overhears: set[str] = set()
        self._kept: list[bytes] = []
        self._topics: tuple[bytes, ...] = ()

    def _socket(self, kind: int, linger: int) -> zmq.Socket:
        socket = self.context.socket(kind)
        socket.set(zmq.LINGER, linger)
        return socket

    def _outlet(self) -> zmq.Socket:
        socket = self._socket(zmq.XPUB, -1)
        socket.set(zmq.XPUB_VERBOSER, 1)  # each one who comes or goes is told
        socket.set(zmq.SNDHWM, HIGH_WATER)
        socket.set(zmq.MAXMSGSIZE, 1024)  # subscriptions only
        if not self.real:
            socket.set(zmq.XPUB_NODROP, 1)
            socket.set(zmq.SNDTIMEO, LOOK)
        return socket

    def bind(self, host: str | None) -> dict[str, list[str]]:
        """Bind both outlets, locally and, where a host is given (`address` or `address:port`), there.

        Returns the endpoints by outlet. PortInUse: somebody else has that port.
        """
        endpoints: dict[str, list[str]] = {}
        for step, (name, socket) in enumerate((("force", self._force), ("observers", self._observers))):
            if host and self.key is not None:
                self._keeper = self._keeper or Keeper(self.context, self.key)
                self.key.secure(socket, server=True)
            local = endpoint(self.run, self.group, name)
            self._bind(socket, local)
            endpoints[name] = [local]
            if host:
                address, _, port = host.partition(":")
                wanted = f"tcp://{address}:{int(port) + step}" if port else f"tcp://{address}:*"
                self._bind(socket, wanted)
                endpoints[name].append(socket.get_string(zmq.LAST_ENDPOINT).rstrip("\0"))
        return endpoints

    def _bind(self, socket: zmq.Socket, address: str) -> None:
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            raise PortInUse(f"cannot bind {address}: {error.strerror}") from None

    # -- with the launcher ---------------------------------------------------------------------------------------

    def report(self, report: Report) -> None:
        """Tell the launcher."""
        self._reports.send(msgspec.msgpack.encode(Addressed(self.group, report)))  # type: ignore[arg-type]

    def order(self, wait: int = 0) -> Order | None:
        """The launcher's next order; None where none comes within so many milliseconds."""
        while self._control.poll(wait):
            try:
                return ORDERS.decode(split(self._control.recv(zmq.NOBLOCK))[1])
            except (msgspec.MsgspecError, ValueError):
                self.foreign += 1
            except zmq.Again:
                pass
        return None

    # -- streams of other groups ---------------------------------------------------------------------------------

    def inlet(self, stream: str) -> Inlet:
        """Where the nodes here read a stream of another group."""
        if stream not in self._inlets:
            ends = self._pairs.get((stream, self.group))
            self._inlets[stream] = (
                ZmqInlet(self._socket(zmq.SUB, 0), stream, self.wait)
                if ends is None
                else LocalInlet(ends[0], self.wait, exact=self.real)
            )
        return self._inlets[stream]

    def connect(self, address: str, streams: Iterable[str], observed: bool, secured: bool, group: str) -> None:
        """Read these streams from the outlet of a group at `address`."""
        known = [self._inlets[stream] for stream in streams] if not observed else []
        sockets = [self._observed] if observed else [inlet.socket for inlet in known if isinstance(inlet, ZmqInlet)]
        for socket in sockets:
            connect(socket, address, self.key if secured else None)
        if observed:
            self._sources[group] = address
            for stream in streams:
                if stream not in self._overhears:  # each time is counted where it is sent
                    self._overhears.add(stream)
                    self._observed.subscribe(stream.encode() + b"\0")

    def ended(self, group: str) -> None:
        """The last frame of a group that is observed here was taken: so it may close."""
        if group in self._sources:
            self._observed.disconnect(self._sources.pop(group))

    def forget(self) -> None:
        """Throw away what was sent to a predecessor."""
        for inlet in self._inlets.values():
            inlet.forget()

    def overheard(self, wait: bool) -> bytes | None:
        """The next frame for the observers here; None where none has come, or none comes in time."""
        try:
            return self._observed.recv(0 if wait else zmq.NOBLOCK)
        except zmq.Again:
            return None

    # -- streams of this group -----------------------------------------------------------------------------------

    def zmq_outlet(self, holds: Callable[[], None]) -> ZmqOutlet:
        """Where nodes of other groups hear what is sent by ZeroMQ."""
        return ZmqOutlet(self._force, holds)

    def local_outlet(self, stream: str, groups: Iterable[str], holds: Callable[[], None]) -> LocalOutlet:
        """Where these groups hear a stream that is sent by the local carrier."""
        return LocalOutlet([self._pairs[stream, group][1] for group in groups], None if self.real else holds)

    def wait_linked(self, nodes: dict[str, int], observers: dict[str, int], look: Callable[[], object]) -> None:
        """Wait until each stream has its readers, at the outlet for nodes and at that for observers.

        look  called again and again meanwhile (it may raise)
        """
        for socket, expected in ((self._force, nodes), (self._observers, observers)):
            missing = {stream.encode() + b"\0": count for stream, count in expected.items() if count}
            if socket is self._force:
                self._readers = sum(missing.values())
            while any(count > 0 for count in missing.values()):
                if not socket.poll(LOOK):
                    look()
                    continue
                note = socket.recv()
                if socket is self._observers:
                    self._listener(note)
                if note[:1] == b"\x01" and note[1:] in missing:
                    missing[note[1:]] -= 1

    def sends(self, streams: Iterable[str]) -> None:
        """The streams that observers can listen to here."""
        self._topics = tuple(stream.encode() + b"\0" for stream in (*streams, HEALTH, END))

    def _listener(self, note: bytes) -> None:
        """An observer comes or goes. A subscription is a prefix; one that fits no stream is not kept."""
        if note[:1] not in (b"\x00", b"\x01"):
            self.foreign += 1
            return
        if not any(topic.startswith(note[1:]) for topic in self._topics):
            return
        count = self.listeners.get(note[1:], 0) + (1 if note[:1] == b"\x01" else -1)
        if count > 0:
            self.listeners[note[1:]] = count
        else:
            self.listeners.pop(note[1:], None)

    def heard(self, stream: str) -> bool:
        """Whether an observer listens to this stream."""
        topic = stream.encode() + b"\0"
        return any(topic.startswith(listener) for listener in self.listeners)

    def keep(self, data: bytes) -> None:
        """Keep a frame for the observers; `flush` sends it."""
        self._kept.append(data)

    def flush(self, holds: Callable[[], None]) -> bool:
        """Send the kept frames, and learn who listens. Returns whether that has changed.

        holds  called again and again while an observer has no room, on the simulated clock
        """
        kept, self._kept = self._kept, []
        for place, data in enumerate(kept):
            while True:
                try:
                    self._observers.send(data)
                    break
                except zmq.Again:
                    try:
                        holds()
                    except BaseException:
                        self._kept = kept[place:]
                        raise
        changed = False
        while int(self._observers.get(zmq.EVENTS)) & zmq.POLLIN:
            changed = True
            self._listener(self._observers.recv())
        return changed

    def _wait_taken(self) -> None:
        """Wait until all have taken what was sent: nodes elsewhere close their inlets, observers leave at the end."""
        while self.heard(END):
            if self._observers.poll(LOOK):
                self._listener(self._observers.recv())
        while self._readers > 0 and not self.real:
            if self._force.poll(LOOK) and self._force.recv()[:1] == b"\x00":
                self._readers -= 1

    def close(self, orderly: bool) -> None:
        """Deliver what is under way and close; after an orderly end say that this was all."""
        for inlet in self._inlets.values():
            inlet.close()
        self._observed.close(linger=0)
        with contextlib.suppress(zmq.ZMQError):
            self.flush(_wait)
            if orderly:
                self._observers.set(zmq.XPUB_NODROP, 1)
                self._observers.set(zmq.SNDTIMEO, LOOK)
                self._kept.append(frame(END, self.group.encode()))
                self.flush(_wait)
                self._wait_taken()
        if self._keeper is not None:
            self._keeper.close()
        self._control.close(linger=0)
        self.context.destroy()


def _wait() -> None:
    """An observer without room is alive, or is ended by the launcher."""
