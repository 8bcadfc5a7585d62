"""The sockets of a worker process: orders in, reports out, and outlets for nodes, for observers and for other programs.

A frame of ZeroMQ is the stream's name, a zero byte, and the message as one msgpack map. The outlets are publishers, so
any program can subscribe by the stream's name. Nodes on the same machine are reached without libzmq and its threads
(`outlet`, `inlet`). The observers of the run and external programs have an outlet each: their frames are buffered and
sent in bursts, because waking a second reader costs 60-100 us, which is too long on the force path.

On the simulated clock an outlet waits for slow workers of the run; on the real clock it drops messages, and the reader
counts them. It never waits for external programs; their losses are counted here. libzmq cannot distinguish readers, so
on the simulated clock the address of its outlet is removed once the readers of the run are connected. The outlet is
closed when its readers have received everything: ZeroMQ would discard frames for which a reader had no buffer.
"""

import contextlib
import os
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import msgspec
import zmq

from palpate.engine.clock import POLL_INTERVAL, now
from palpate.engine.slot import Output
from palpate.launch.run.hop.blocks import Framer, join_blocks
from palpate.launch.run.reports import ORDERS, REPEATED, Addressed, Beat, NodesEnded, Note, Order, Report
from palpate.launch.run.wire.addresses import endpoint
from palpate.launch.run.wire.inlet import HIGH_WATER, LONGEST_FRAME, Inlet, TcpInlet
from palpate.launch.run.wire.keys import Authenticator, Key, connect
from palpate.launch.run.wire.outlet import Outlet, ReaderConnection, Sender
from palpate.launch.run.wire.parcels import Packer, Unpacker
from palpate.launch.run.wire.watch import SocketPoller
from palpate.nodes.base import Block
from palpate.physics.errors import RunError

HEALTH = "!health"  # stream of each outlet for observers with the health of the nodes
END = "!end"
"""End-of-stream marker of each outlet for observers; the payload is the group. For the observers of the run a zero byte
and the last health of its nodes follow, so that messages that were dropped at the end are counted."""
LONGEST_ORDER = 1 << 26  # [bytes]
AHEAD = 200  # parcels that an observer buffers, and that are buffered for it on simulated time
QUEUED = 4000
"""Parcels that are buffered for each observer of the run on the real clock, 64 MB at most: a log process gets little
processor time next to a browser that draws in software."""
TOGETHER = 10_000_000  # [ns] that a short frame waits for others: a queue is limited by the number of its parcels
LINK_TIME = 1_000_000_000  # [ns] timeout on the real clock for a writer that accepts the connection and stays silent
AGAIN_TIME = 300_000_000  # [ns] in which observers of a restarted worker connect: three intervals of libzmq


def frame(stream: str, payload: bytes) -> bytes:
    return stream.encode() + b"\0" + payload


def split(data: bytes) -> tuple[str, bytes]:
    """Stream and payload of a frame. ValueError: no zero byte, or a name that is not UTF-8."""
    topic, zero, payload = data.partition(b"\0")
    if not zero:
        raise ValueError(f"not a frame: no zero byte among {len(data)} bytes")
    return topic.decode(), payload


class Exchange:
    """The numbers of orders and reports of one worker, see `ControlChannel`.

    repeats  whether its connection may break, so that its reports are sent again
    """

    def __init__(self, group: str, repeats: bool) -> None:
        self._group, self._repeats = group, repeats
        self._taken = 0  # number of the last order
        self._number = self._checked = 0  # of the last report, and of the last one at the last heartbeat
        self._unread: dict[int, bytes] = {}  # reports that have not arrived, as far as is known

    def take(self, data: bytes) -> Order | None:
        """The order of a frame, if it is the next one. ValueError, MsgspecError: not an order."""
        number, _, encoded = split(data)[1].partition(b" ")
        if int(number) not in (0, self._taken + 1):
            return None
        self._taken = max(self._taken, int(number))
        return ORDERS.decode(encoded)

    def write(self, report: Report) -> bytes:
        """A report as a frame."""
        number = 0
        if self._repeats and isinstance(report, REPEATED):
            number = self._number = self._number + 1
        data = msgspec.msgpack.encode(Addressed(self._group, report, number))
        if number:
            self._unread[number] = data
        return data

    def lost(self, received: int) -> list[bytes]:
        """The reports to send again after a heartbeat: all from the first that was sent before the last heartbeat and
        has not arrived."""
        self._unread = {number: data for number, data in self._unread.items() if number > received}
        checked, self._checked = self._checked, self._number
        return list(self._unread.values()) if min(self._unread, default=checked + 1) <= checked else []


class Bus:
    """Sockets of one worker.

    run, group  names of the run and of the worker
    control     endpoint of the launcher's control publisher
    reports     endpoint where the launcher takes reports
    real        whether it is the real clock: no waiting for slow readers
    external    streams that other groups read, and those groups
    key         encrypts outlets on TCP; None: no encryption
    guarded     whether the launcher's sockets are encrypted with the key
    local       whether other workers and programs on this machine connect by Unix sockets, otherwise by TCP
    """

    def __init__(
        self,
        run: str,
        group: str,
        control: str,
        reports: str,
        real: bool,
        external: Mapping[str, Collection[str]] | None = None,
        key: Key | None = None,
        guarded: bool = False,
        local: bool = True,
    ) -> None:
        self.context = zmq.Context()
        self.run, self.group, self.real, self.key, self.local = run, group, real, key, local
        self._external = external or {}
        self._watch = SocketPoller()
        self._keeper: Authenticator | None = None
        self._control = self._socket(zmq.SUB, 0)
        self._control.set(zmq.MAXMSGSIZE, LONGEST_ORDER)
        self._reports = self._socket(zmq.PUSH, 2000)
        for socket, address in ((self._control, control), (self._reports, reports)):
            connect(socket, address, key if guarded else None)
        self._control.subscribe(f"~{group}".encode() + b"\0")
        self._ordered = True  # whether orders may be waiting
        self._exchange = Exchange(group, repeats=not local)
        self._watch.add(int(self._control.get(zmq.FD)), self._note_order)
        self._outlet = Outlet(group, self._external, real, self._watch)
        self._far: zmq.Socket | None = None  # for nodes on other machines
        self._far_readers: Counter[bytes] = Counter()
        self._public = Outlet(group, {}, real, self._watch)  # for external programs
        # Delivery has no timeout: the launcher kills readers that hang.
        self._observers = self._publisher(QUEUED)
        self._send = zmq.backend.Socket.send.__get__(self._observers)  # without the overhead of pyzmq's options
        self._observed = self._socket(zmq.SUB, 0)
        self._observed.set(zmq.RCVHWM, AHEAD)
        self._observed.set(zmq.RCVTIMEO, POLL_INTERVAL)
        self._observed.set(zmq.MAXMSGSIZE, LONGEST_FRAME)
        self._inlets: dict[str, Inlet | TcpInlet] = {}
        self._tcp: list[Inlet | TcpInlet] = []
        self._apart: set[Inlet] = set()
        self._ready: list[Inlet | TcpInlet] = []
        self.listeners: dict[bytes, int] = {}
        self._sources: dict[str, str] = {}  # endpoint of each group that is observed here
        self._overhears: set[str] = set()
        self._kept: list[bytes] = []  # for observers of the run
        self._parcels: deque[bytes] = deque()  # of them, not yet sent
        self._shown: list[bytes] = []  # for other programs
        self._blocks = True  # whether observers of the run get blocks
        self._framers: dict[tuple[str, ...], Framer] = {}  # by the streams of a segment
        self._packed = 0  # [ns] when no frame waited for others
        self._packer, self._unpacker = Packer(together=real), Unpacker(LONGEST_FRAME)
        self._unpacked: deque[bytes] = deque()  # frames for the observers here
        self.final: list[bytes] = []
        """The last health of the nodes here, encoded; set it before `close`."""
        self._topics: tuple[bytes, ...] = ()

    def _socket(self, kind: int, linger: int) -> zmq.Socket:
        socket = self.context.socket(kind)
        socket.set(zmq.LINGER, linger)
        return socket

    def _publisher(self, longest: int) -> zmq.Socket:
        socket = self._socket(zmq.XPUB, -1)
        socket.set(zmq.XPUB_VERBOSER, 1)  # report every subscription and cancellation
        socket.set(zmq.SNDHWM, longest if self.real else min(longest, AHEAD))
        socket.set(zmq.MAXMSGSIZE, 1024)  # subscriptions only
        if not self.real:
            socket.set(zmq.XPUB_NODROP, 1)
            socket.set(zmq.SNDTIMEO, POLL_INTERVAL)
        return socket

    def bind(self, host: str | None) -> dict[str, list[str]]:
        """Bind all outlets locally and, with a host (`address` or `address:port`), those of the run on TCP.

        Returns the endpoints by outlet, the local ones first. RunError: the port is in use.
        """
        self._blocks = not host
        if host and self.key is not None:
            self._keeper = Authenticator(self.context, self.key)
            self.key.secure(self._observers, server=True)
        endpoints: dict[str, list[str]] = {"force": [], "observers": []}
        if self.local:
            local = {name: endpoint(self.run, self.group, name) for name in ("force", "observers", "members")}
            for name, outlet in (("force", self._outlet), ("observers", self._public)):
                try:
                    outlet.bind(local[name].removeprefix("ipc://"))
                except OSError as error:
                    raise RunError(f"cannot bind {local[name]}: {error.strerror}") from None
            self._bind(self._observers, local["members"])
            endpoints = {"force": [local["force"]], "observers": [local["members"]]}
        if host:
            self._far = self._publisher(HIGH_WATER)
            if self.key is not None:
                self.key.secure(self._far, server=True)
            address, _, port = host.partition(":")
            for step, (name, socket) in enumerate((("force", self._far), ("observers", self._observers))):
                self._bind(socket, f"tcp://{address}:{int(port) + step}" if port else f"tcp://{address}:*")
                endpoints[name].append(socket.get_string(zmq.LAST_ENDPOINT).rstrip("\0"))
        return endpoints

    def _bind(self, socket: zmq.Socket, address: str) -> None:
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            raise RunError(f"cannot bind {address}: {error.strerror}") from None

    # -- with the launcher ---------------------------------------------------------------------------------------

    def report(self, report: Report) -> None:
        self._reports.send(self._exchange.write(report))

    def _note_order(self) -> None:
        self._ordered = True

    def order(self, wait: int = 0) -> Order | None:
        """Return the launcher's next order; None if none arrives within `wait` [ms]. With 0: only one that `sweep` has
        noted."""
        while (wait or self._ordered) and self._control.poll(wait):
            self._ordered = True
            with contextlib.suppress(msgspec.MsgspecError, ValueError, zmq.Again):
                order = self._exchange.take(self._control.recv(zmq.NOBLOCK))
                if isinstance(order, Beat):
                    for data in self._exchange.lost(order.received):
                        self._reports.send(data)
                if order is not None:
                    return order
        self._ordered = False
        return None

    def sweep(self, wait: int = 0) -> list[Inlet | TcpInlet]:
        """Poll all sockets for `wait` [ms]: serve readers and note waiting orders. Returns the inlets that may have
        messages, valid until the next call."""
        self._ready.clear()
        self._watch.poll(wait)
        self._outlet.tend()
        self._public.tend()
        if self._apart:
            for inlet in tuple(self._apart):
                inlet.reach()
        return self._ready + self._tcp if self._tcp else self._ready

    # -- streams of other groups ---------------------------------------------------------------------------------

    def inlet(self, stream: str) -> Inlet | TcpInlet:
        if stream not in self._inlets:
            self._inlets[stream] = Inlet(stream, self.group, self._watch, self._ready.append, self._apart)
        return self._inlets[stream]

    def connect(self, address: str, streams: Iterable[str], observed: bool, secured: bool, group: str) -> None:
        """Read these streams from the outlet of a group at `address`."""
        key = self.key if secured else None
        if not observed:
            for stream in streams:
                inlet = self.inlet(stream)
                if address.startswith("tcp:") and isinstance(inlet, Inlet):
                    inlet = self._inlets[stream] = TcpInlet(self._socket(zmq.SUB, 0), stream)
                    self._tcp.append(inlet)
                if isinstance(inlet, TcpInlet):
                    connect(inlet.socket, address, key)
                else:
                    inlet.connect(address.removeprefix("ipc://"))
            return
        connect(self._observed, address, key)
        self._sources[group] = address
        for stream in streams:
            if stream not in self._overhears:  # the sender counts every subscription
                self._overhears.add(stream)
                self._observed.subscribe(stream.encode() + b"\0")

    def end_group(self, group: str) -> None:
        """The last frame of an observed group was received: disconnect, so that it can close."""
        if group in self._sources:
            self._observed.disconnect(self._sources.pop(group))

    def overheard(self, wait: bool) -> bytes | None:
        """Return the next frame for the observers here, or None; `wait`: wait for one, up to `POLL_INTERVAL`."""
        while not self._unpacked:
            try:
                parcel = self._observed.recv(0 if wait else zmq.NOBLOCK)
                self._unpacked += join_blocks(self._unpacker.unpack(parcel))
            except zmq.Again:
                return None
        return self._unpacked.popleft()

    # -- streams of this group -----------------------------------------------------------------------------------

    def sender(self, stream: str, holds: Callable[[], None]) -> Sender:
        """The sender of a stream to nodes of other groups.

        holds  called repeatedly while a reader's buffer is full, on the simulated clock
        """
        return self._outlet.sender(stream, self._far, holds)

    def readers(self) -> int:
        """Version of the readers of the senders, which changes with each subscription; queued data is sent on."""
        self._outlet.tend()
        return self._outlet.version

    def served_readers(self) -> bool:
        """Whether readers were served since the last call, so that there may be more to do."""
        served = self._outlet.served_readers or self._public.served_readers
        self._outlet.served_readers = self._public.served_readers = False
        return served

    def waits_for(self, reader: ReaderConnection) -> bool:
        """Whether a full buffer of this reader blocks its sender."""
        return self._outlet.waits_for(reader)

    def wait_linked(self, observers: dict[str, int], poll: Callable[[], object], awaited: bool = True) -> None:
        """Wait until all readers of all streams and all writers of the nodes here are connected.

        awaited  if not, wait for no nodes, and for observers at most `AGAIN_TIME`: before they are connected they miss
                 messages, so that a recording would lack the first steps of a restarted node
        poll     called repeatedly meanwhile (it may raise)
        """
        external = self._external if awaited else {}
        missing = {stream.encode() + b"\0": count for stream, count in observers.items() if count}
        until, again = now() + LINK_TIME, now() + AGAIN_TIME
        wakes = [int(socket.get(zmq.FD)) for socket in (self._observers, self._far) if socket is not None]
        for number in wakes:
            self._watch.add(number, lambda: None)
        while (
            (any(count > 0 for count in missing.values()) and (awaited or now() < again))
            or any(
                self._outlet.count_groups(stream) + self._far_readers[stream.encode() + b"\0"] < len(groups)
                for stream, groups in external.items()
            )
            or (any(inlet.awaits_writer for inlet in self._inlets.values()) and not (self.real and now() > until))
        ):
            for note in self._subscriptions(self._observers):
                self._listener(note)
                if note[:1] == b"\x01" and note[1:] in missing:
                    missing[note[1:]] -= 1
            self._count_far()
            for inlet in self.sweep(POLL_INTERVAL):
                inlet.take()  # discard messages for the previous worker of this group
            poll()
        for number in wakes:
            self._watch.remove(number)
        if self.local and not self.real:
            os.unlink(endpoint(self.run, self.group, "members").removeprefix("ipc://"))

    def _subscriptions(self, socket: zmq.Socket) -> Iterable[bytes]:
        """New subscriptions and cancellations at a publisher."""
        while int(socket.get(zmq.EVENTS)) & zmq.POLLIN:
            yield socket.recv()

    def _count_far(self) -> None:
        if self._far is not None:
            for note in self._subscriptions(self._far):
                self._far_readers[note[1:]] += 1 if note[:1] == b"\x01" else -1

    def sends(self, streams: Iterable[str]) -> None:
        """Set the streams that observers can subscribe to here."""
        self._topics = tuple(stream.encode() + b"\0" for stream in (*streams, HEALTH, END))

    def _listener(self, note: bytes) -> None:
        """Count a subscription or cancellation of an observer. It is a prefix; one that fits no stream is ignored."""
        if note[:1] not in (b"\x00", b"\x01") or not any(topic.startswith(note[1:]) for topic in self._topics):
            return
        count = self.listeners.get(note[1:], 0) + (1 if note[:1] == b"\x01" else -1)
        if count > 0:
            self.listeners[note[1:]] = count
        else:
            self.listeners.pop(note[1:], None)

    def has_reader(self, stream: str) -> bool:
        """Whether an observer or external program reads this stream."""
        return self._observed_by_members(stream) or self._public.has_reader(stream.encode() + b"\0")

    def _observed_by_members(self, stream: str) -> bool:
        topic = stream.encode() + b"\0"
        return any(topic.startswith(listener) for listener in self.listeners)

    def keep(self, data: bytes) -> None:
        """Buffer a frame for the observers; `flush` sends it."""
        self._kept.append(data)
        self._shown.append(data)

    def keep_block(self, block: Block, outputs: Sequence[Output]) -> None:
        """Buffer the messages of the observed outputs in a block: frames of many messages for the observers of the run,
        frames of one message for other programs and other machines.

        outputs  those of the block, by number
        """
        if self._blocks and self.listeners:
            streams = tuple(block.streams)
            framer = self._framers.get(streams)
            if framer is None:
                framer = self._framers[streams] = Framer(outputs)
            self._kept += framer.frames(block)
        for number, output in enumerate(outputs):
            if not output.observed:
                continue
            kept = [self._shown] if self._public.has_reader(output.topic) else []
            if not self._blocks:
                kept.append(self._kept)
            for _, _, payload in block.of(number).messages() if kept else ():
                for each in kept:
                    each.append(output.topic + payload)

    def flush(self, holds: Callable[[], None] = lambda: None, rest: bool = True) -> None:
        """Send the buffered frames.

        rest   if not, short frames may wait up to `TOGETHER` for others of their stream, on the real clock
        holds  called repeatedly while the buffer of an observer of the run is full, on the simulated clock; the
               launcher kills observers that hang
        """
        shown, self._shown = self._shown, []
        self._public.publish(shown)
        moment = now()
        rest = rest or moment - self._packed > TOGETHER
        self._parcels += self._packer.pack(self._kept, rest)
        self._packed = moment if rest else self._packed
        self._kept.clear()
        while self._parcels:
            try:
                self._send(self._parcels[0])
            except zmq.Again:
                holds()
            else:
                self._parcels.popleft()

    def update_listeners(self) -> bool:
        """Update the subscriptions of observers; returns whether one has changed."""
        changed, self._public.changed = self._public.changed, False
        for note in self._subscriptions(self._observers):
            changed = True
            self._listener(note)
        return changed

    def _end(self) -> bytes:
        """The end-of-stream marker for the observers of the run."""
        final = b"\0" + msgspec.msgpack.encode(self.final) if self.final else b""
        return frame(END, self.group.encode()) + final

    def offer_end(self) -> None:
        """On the real clock, after the last message of the nodes here and while observers here still receive: send the
        end-of-stream marker if all observers have room for it, since two groups may wait for the markers of each other.
        `close` sends it again."""
        with contextlib.suppress(zmq.Again):
            self._observers.set(zmq.XPUB_NODROP, 1)
            self._observers.send(self._end(), zmq.NOBLOCK)

    def _wait_taken(self, end: bytes, orphaned: Callable[[], bool]) -> None:
        """Wait until libzmq has delivered everything: remote nodes close their inlets, observers disconnect. Messages
        to nodes on this machine are in kernel buffers, which outlive this worker.

        end  the end-of-stream marker. It is sent repeatedly, because libzmq silently skips a connection that was full
             until it has found room there; `XPUB_NODROP` does not cover this case
        """
        while self._observed_by_members(END) and not orphaned():
            if self._observers.poll(POLL_INTERVAL):
                self._listener(self._observers.recv())
            else:
                with contextlib.suppress(zmq.Again):
                    self._observers.send(end, zmq.NOBLOCK)
        if self._far is not None and not self.real:
            while any(self._far_readers[stream.encode() + b"\0"] > 0 for stream in self._external) and not orphaned():
                self._far.poll(POLL_INTERVAL)
                self._count_far()

    def end(self, clean_exit: bool) -> None:
        """Send the last reports: notes on the readers, and that all nodes have ended. The launcher does not wait for
        later ones."""
        for text in (*self._outlet.notes(), *self._public.notes()):
            self.report(Note(text))
        self.report(NodesEnded(clean_exit))

    def close(self, clean_exit: bool, orphaned: Callable[[], bool] = lambda: False) -> None:
        """Deliver buffered frames and close. After a clean exit, send the end-of-stream marker.

        orphaned  asked repeatedly meanwhile: whether the launcher has ended, so that no other process ends readers that
                  hang
        """

        def holds() -> None:
            if orphaned():
                self._parcels.clear()

        for inlet in self._inlets.values():
            inlet.close()
        self._observed.close(linger=0)
        with contextlib.suppress(zmq.ZMQError):
            self.flush(holds)
            if clean_exit:
                self._observers.set(zmq.XPUB_NODROP, 1)
                self._observers.set(zmq.SNDTIMEO, POLL_INTERVAL)
                self._shown.append(frame(END, self.group.encode()))
                self._kept.append(self._end())
                self.flush(holds)
                self.update_listeners()
                self._wait_taken(self._end(), orphaned)
        linger = 0 if orphaned() else None
        self._outlet.close()
        self._public.close()
        if self._keeper is not None:
            self._keeper.close()
        self._control.close(linger=0)
        self.context.destroy(linger=linger)
