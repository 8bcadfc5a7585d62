"""The sockets of a worker process: what it reads, one outlet for the nodes of the graph, one for observers.

A frame is the stream's name, a zero byte, and the message as one msgpack map. The outlets are publishers, so that any
program can subscribe by the stream's name. Observers have an outlet of their own: frames for them are kept back and
sent in bursts, because waking a second reader costs 60-100 us, which the force path must not pay.

On the simulated clock an outlet waits when a reader is slow; on the real clock it drops, and the reader counts.
"""

from __future__ import annotations

import contextlib
import json
from collections import deque
from collections.abc import Mapping, Sequence

import zmq

from palpate.launch.running.inbox import Box, Inbox, Pair

CONTROL = b"~"
HEALTH = "!health"
"""Stream of each outlet for observers on which its worker tells how the nodes are doing."""
HIGH_WATER = 20_000  # frames held for a slow reader
LINGER = 2_000  # [ms] that a closing socket goes on delivering


class PortInUse(OSError):
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


def order(data: bytes) -> dict:
    """What a control frame of the launcher asks for."""
    return json.loads(split(data)[1])


def endpoint(run: str, group: str, outlet: str) -> str:
    """Local address of an outlet, in Linux' abstract name space: no file to leave behind."""
    return f"ipc://@palpate/{run}/{group}/{outlet}"


class Bus:
    """Sockets of one worker.

    run, group     names of the run and of the worker
    control        endpoint of the launcher's control publisher
    reports        endpoint where the launcher takes reports
    wait_for_slow  true on the simulated clock
    inboxes        of the workers of this machine, by name
    patience       [s] after which a blocking receive gives up once, so that the caller can look round
    """

    def __init__(
        self,
        run: str,
        group: str,
        control: str,
        reports: str,
        wait_for_slow: bool,
        inboxes: Mapping[str, Pair],
        patience: float = 0.1,
    ) -> None:
        self.context = zmq.Context()
        self.run, self.group = run, group
        self.wait_for_slow = wait_for_slow
        self.subscriber = self._socket(zmq.SUB)
        self.subscriber.set(zmq.RCVHWM, HIGH_WATER)
        milliseconds = max(1, round(patience * 1000))
        self.subscriber.set(zmq.RCVTIMEO, milliseconds)
        self.subscriber.set(zmq.RECONNECT_IVL, 5)
        self.subscriber.connect(control)
        for topic in (f"~{group}", "~*"):
            self.subscriber.subscribe(topic.encode() + b"\0")
        self.reports = self._socket(zmq.PUSH)
        self.reports.connect(reports)
        self.force = self._outlet()
        self.observers = self._outlet()
        # The plain send of the binding, without the layer that looks for multipart and tracking options.
        self.send = zmq.backend.Socket.send.__get__(self.force)
        """Send a frame to the nodes that read it."""
        self.listeners: dict[bytes, int] = {}
        self._boxes = {name: write for name, (_, write) in inboxes.items()}
        self._inbox = Inbox(inboxes[group][0], self.subscriber, milliseconds) if group in inboxes else None
        self._kept: list[bytes] = []
        self._early: deque[bytes] = deque()
        self._first: deque[bytes] = deque()

    def _socket(self, kind: int) -> zmq.Socket:
        socket = self.context.socket(kind)
        socket.set(zmq.LINGER, LINGER)
        return socket

    def _outlet(self) -> zmq.Socket:
        socket = self._socket(zmq.XPUB)
        socket.set(zmq.XPUB_VERBOSE, 1)
        socket.set(zmq.SNDHWM, HIGH_WATER)
        if self.wait_for_slow:
            socket.set(zmq.XPUB_NODROP, 1)
        return socket

    def bind(self, host: str | None) -> dict[str, list[str]]:
        """Bind both outlets, locally and, where a host is given (`tcp://address` or `tcp://address:port`), there.

        Returns the endpoints by outlet. PortInUse: somebody else has that port.
        """
        found: dict[str, list[str]] = {}
        for step, (name, socket) in enumerate((("force", self.force), ("observers", self.observers))):
            local = endpoint(self.run, self.group, name)
            self._bind(socket, local)
            found[name] = [local]
            if host:
                address, _, port = host.removeprefix("tcp://").partition(":")
                wanted = f"tcp://{address}:{int(port) + step}" if port else f"tcp://{address}:*"
                self._bind(socket, wanted)
                found[name].append(socket.get_string(zmq.LAST_ENDPOINT).rstrip("\0"))
        return found

    def _bind(self, socket: zmq.Socket, address: str) -> None:
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            raise PortInUse(f"cannot bind {address}: {error.strerror}") from None

    def connect(self, address: str, streams: list[str]) -> None:
        """Read these streams from the outlet at `address`."""
        self.subscriber.connect(address)
        for stream in streams:
            self.subscriber.subscribe(stream.encode() + b"\0")

    def forget(self) -> None:
        """Throw away what was sent to a predecessor that has died, and since."""
        self._early.clear()
        if self._inbox is not None:
            self._inbox.clear()

    def boxes(self, groups: Sequence[str]) -> tuple[Box, ...]:
        """The inboxes of these workers; empty where one of them has none."""
        return tuple(self._boxes[group] for group in groups) if self._boxes.keys() >= set(groups) else ()

    def wait_linked(self, nodes: dict[str, int], observers: dict[str, int], timeout: float) -> bool:
        """Wait until each stream has its readers, at the outlet for nodes and at that for observers.

        Returns whether they all came in time [s].
        """
        for socket, expected in ((self.force, nodes), (self.observers, observers)):
            missing = {stream.encode() + b"\0": count for stream, count in expected.items() if count}
            while any(count > 0 for count in missing.values()):
                if not socket.poll(int(timeout * 1000)):
                    return False
                note = socket.recv()
                if socket is self.observers:
                    self._listener(note)
                if note[:1] == b"\x01" and note[1:] in missing:
                    missing[note[1:]] -= 1
        return True

    def _listener(self, note: bytes) -> None:
        count = self.listeners.get(note[1:], 0) + (1 if note[:1] == b"\x01" else -1)
        if count > 0:
            self.listeners[note[1:]] = count
        else:
            self.listeners.pop(note[1:], None)

    def heard(self, topic: bytes) -> bool:
        """Whether an observer listens to this topic (stream name and zero byte); a subscription is a prefix."""
        return any(topic.startswith(listener) for listener in self.listeners)

    def keep(self, data: bytes) -> None:
        """Keep a frame for the observers; `flush` sends it."""
        self._kept.append(data)

    def flush(self) -> bool:
        """Send the kept frames, and learn who listens. Returns whether that has changed."""
        for data in self._kept:
            try:
                self.observers.send(data)
            except zmq.Again:
                break  # real clock: the observers are slow, they count what they miss
        self._kept.clear()
        changed = False
        while int(self.observers.get(zmq.EVENTS)) & zmq.POLLIN:
            changed = True
            self._listener(self.observers.recv())
        return changed

    def orders(self) -> dict:
        """The launcher's next order before the start; messages from workers that have begun already are put aside."""
        while True:
            data = self.receive(block=True)
            if data is None:
                continue
            if data[:1] == CONTROL:
                return order(data)
            self._early.append(data)

    def release(self) -> None:
        """The messages that were put aside come first from now on."""
        self._first, self._early = self._early, deque()

    def receive(self, block: bool) -> bytes | None:
        """The next frame; None when none has come."""
        if self._first:
            return self._first.popleft()
        if self._inbox is not None:
            return self._inbox.receive(block)
        try:
            return self.subscriber.recv() if block else self.subscriber.recv(zmq.NOBLOCK)
        except zmq.Again:
            return None

    def waiting(self) -> bool:
        """Whether a frame may have come."""
        if self._first:
            return True
        if self._inbox is not None:
            return self._inbox.waiting()
        return bool(int(self.subscriber.get(zmq.EVENTS)) & zmq.POLLIN)

    def close(self) -> None:
        """Deliver what is under way and close."""
        with contextlib.suppress(zmq.ZMQError):
            self.flush()
        # It would wait to renew its subscriptions with senders that have gone.
        self.subscriber.close(linger=0)
        self.context.destroy(linger=LINGER)
