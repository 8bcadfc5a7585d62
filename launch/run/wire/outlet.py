"""Outlets: a worker sends its streams to nodes of other groups, by ZMTP over a Unix socket, and by libzmq over TCP.

The computing thread writes each message, one call per reader. Any ZeroMQ program of the same user can also subscribe.

A reader with a full buffer blocks the sender on the simulated clock, and loses the message on the real clock. A partly
sent frame is completed before the next; only whole frames are dropped, and counted. External programs never block the
sender: they have a separate outlet with a queue of `QUEUE` bytes each. On the real clock only one connection request or
command is handled per poll of the sockets, however many clients connect.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import islice

import zmq

from palpate.engine.clock import POLL_INTERVAL, now
from palpate.launch.run.wire.watch import SocketPoller
from palpate.launch.run.wire.zmtp import GREETING, GROUP, SUBSCRIBERS, Connection, ZmtpError, pong, subscription

ROOM = 1 << 20  # [bytes] send buffer of a reader, kernel overhead included; the system may limit it
QUEUE = 4 << 20  # [bytes] queue of an external program
LONGEST_COMMAND = 1024  # [bytes] longest command of a reader
FAREWELL = 200_000_000  # [ns] timeout for delivering queued frames at the end
MOST_BUFFERS = 1000  # in one call; the kernel's limit is 1024
_NOW = getattr(socket, "MSG_DONTWAIT", 0)  # Windows has no such flag, and no outlets
_SHORT = tuple(bytes((0, size)) for size in range(256))  # headers of short frames, by size


def _frame_of(data: bytes) -> bytes:
    size = len(data)
    return (_SHORT[size] if size <= 255 else b"\2" + size.to_bytes(8, "big")) + data


class ReaderConnection:
    """A connection to a reader. `rest`: data still to be sent, `queued` bytes in all: the end of a partly sent frame,
    and for external programs the frames after it."""

    def __init__(self, end: socket.socket, group: str) -> None:
        self.end = end
        self.pid, _, _ = struct.unpack("3i", end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
        self.connection = Connection(b"PUB", SUBSCRIBERS, LONGEST_COMMAND, group)
        self.group = ""  # the group of a worker; empty for others
        self.topics: Counter[bytes] = Counter()
        self.rest: deque[bytes | memoryview] = deque()
        self.queued = self.dropped = 0
        self.send = end.send

    @property
    def name(self) -> str:
        """Name for messages to the user."""
        return f"group {self.group!r}" if self.group else f"process {self.pid}"

    def write(self, data: bytes) -> int:
        """Send a frame; returns the number of bytes sent. OSError: the reader has disconnected."""
        if self.rest and not self.finish():
            return 0
        try:
            sent = self.send(data, _NOW)
        except BlockingIOError:
            return 0
        if sent != len(data):
            self.keep(memoryview(data)[sent:])
        return sent

    def keep(self, data: bytes | memoryview) -> None:
        self.rest.append(data)
        self.queued += len(data)

    def finish(self) -> bool:
        """Send queued data as far as possible; returns whether the queue is empty. OSError: reader disconnected."""
        try:
            sent = self.end.sendmsg(islice(self.rest, MOST_BUFFERS), (), _NOW)
        except BlockingIOError:
            return False
        self.queued -= sent
        while self.rest and sent >= len(self.rest[0]):
            sent -= len(self.rest.popleft())
        if sent:
            self.rest[0] = memoryview(self.rest[0])[sent:]
        return not self.rest


class Sender:
    """Sends one stream.

    far    publisher for readers on other machines, or None
    holds  called repeatedly while a reader's buffer is full (it may raise)
    """

    def __init__(self, outlet: Outlet, stream: str, far: zmq.Socket | None, holds: Callable[[], None]) -> None:
        self.topic = stream.encode() + b"\0"
        self.readers: tuple[ReaderConnection, ...] = ()
        self._outlet, self._holds = outlet, holds
        # The binding's basic send, without the overhead for multipart and tracking options.
        self._far = None if far is None else zmq.backend.Socket.send.__get__(far)

    @property
    def far(self) -> bool:
        """Whether readers on other machines are served."""
        return self._far is not None

    def frame_payload(self, payload: bytes) -> bytes:
        return _frame_of(self.topic + payload)

    def write(self, reader: ReaderConnection, data: bytes, sent: int) -> None:
        """Send a frame, of which `sent` bytes were sent before, to one reader."""
        size = len(data)
        try:
            if not sent and not reader.rest:
                sent = reader.send(data, _NOW)
        except BlockingIOError:
            pass
        except OSError:
            self._outlet.drop(reader)
            return
        if sent != size:
            self._outlet.handle_full_buffer(reader, data, sent, self._holds)

    def send(self, payload: bytes) -> None:
        topic = self.topic
        data = self.frame_payload(payload)
        for reader in self.readers:
            self.write(reader, data, 0)
        while self._far is not None:
            try:
                self._far(topic + payload)
                return
            except zmq.Again:
                self._holds()


class Outlet:
    """Accepts readers and tracks their subscriptions.

    group     name of the worker
    external  streams that it sends, and the groups that read each
    real      whether it is the real clock: no waiting for slow readers
    watch     poller of the sockets
    """

    def __init__(self, group: str, external: Mapping[str, Collection[str]], real: bool, watch: SocketPoller) -> None:
        self.changed = False  # whether subscriptions have changed
        self.version = 0  # of the readers of the senders
        self._group, self._external, self._real, self._outer = group, external, real, watch
        self._watch = SocketPoller()
        self.served_readers = False  # whether requests or commands of readers have been handled
        self._workers = {name for groups in external.values() for name in groups}
        self._senders: list[Sender] = []
        self._listener: socket.socket | None = None
        self._readers: dict[ReaderConnection, None] = {}
        self._unfinished: set[ReaderConnection] = set()
        self._notes: Counter[str] = Counter()

    def bind(self, path: str) -> None:
        """Listen at a path; without it, no reader can connect here. OSError: not possible."""
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._outer.add(self._watch.fileno(), self._serve_some)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)  # of a previous worker
        self._listener.bind(path)
        self._listener.listen(64)
        self._listener.setblocking(False)
        self._watch.add(self._listener.fileno(), self._accept)

    def sender(self, stream: str, far: zmq.Socket | None, holds: Callable[[], None]) -> Sender:
        self._senders.append(Sender(self, stream, far, holds))
        self._sort()
        return self._senders[-1]

    def count_groups(self, stream: str) -> int:
        topic = stream.encode() + b"\0"
        return len({reader.group for reader in self._readers if reader.group and reader.topics[topic]})

    def has_reader(self, topic: bytes) -> bool:
        return any(topic.startswith(tuple(reader.topics)) for reader in self._readers)

    def publish(self, messages: Sequence[bytes]) -> None:
        """Send messages, each with its stream name and a zero byte in front, to all subscribers: one call per reader.
        Messages that do not fit into a reader's queue are dropped."""
        for reader in tuple(self._readers):
            topics = tuple(reader.topics)
            for data in messages:
                if data.startswith(topics):
                    if reader.queued and reader.queued + len(data) > QUEUE:
                        reader.dropped += 1
                    else:
                        reader.keep(_frame_of(data))
            if reader.rest:
                self._unfinished.add(reader)
        self.tend()

    def _serve_some(self) -> None:
        self.served_readers = self._watch.poll(most=1 if self._real else 64) > 0

    # -- readers -------------------------------------------------------------------------------------------------

    def _accept(self) -> None:
        assert self._listener is not None
        try:
            end = self._listener.accept()[0]
        except OSError:  # the client has disconnected, or there are no file descriptors left
            return
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
        reader = ReaderConnection(end, self._group)
        self._readers[reader] = None
        self._watch.add(end.fileno(), lambda: self._serve(reader))
        with contextlib.suppress(OSError):
            reader.write(GREETING)

    def _serve(self, reader: ReaderConnection) -> None:
        """Read the handshake and the subscriptions of a reader."""
        try:
            data = reader.end.recv(4096, _NOW)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.drop(reader)
            return
        try:
            greets = reader.connection.peer is None
            frames = reader.connection.feed(data)
            if greets and reader.connection.peer is not None:
                group = reader.connection.peer.get(GROUP, b"").decode(errors="replace")
                reader.group = group if group in self._workers else ""
                reader.write(reader.connection.ready)
            for flags, body in frames:
                self._handle_frame(reader, flags, body)
        except ZmtpError as error:
            self._notes[f"a reader of group {self._group!r} was refused, {reader.name}: {error}"] += 1
            self.drop(reader)
        except OSError:
            self.drop(reader)

    def _handle_frame(self, reader: ReaderConnection, flags: int, body: bytes) -> None:
        wanted = subscription(flags, body)
        if wanted is not None:
            subscribes, topic = wanted
            reader.topics[topic] += 1 if subscribes else -1
            if reader.topics[topic] <= 0:
                del reader.topics[topic]
            self._sort()
        elif (answer := pong(flags, body)) is not None:
            reader.write(answer)

    def _sort(self) -> None:
        """Update the readers of each sender. A subscription is a prefix of one or several stream names."""
        self.changed = True
        self.version += 1
        for sender in self._senders:
            sender.readers = tuple(
                reader for reader in self._readers if any(sender.topic.startswith(topic) for topic in reader.topics)
            )

    def drop(self, reader: ReaderConnection) -> None:
        if reader not in self._readers:
            return
        del self._readers[reader]
        self._unfinished.discard(reader)
        self._count(reader)
        self._watch.remove(reader.end.fileno())
        reader.end.close()
        self._sort()

    # -- full buffers --------------------------------------------------------------------------------------------

    def handle_full_buffer(self, reader: ReaderConnection, data: bytes, sent: int, holds: Callable[[], None]) -> None:
        """The buffer of a reader is full after `sent` bytes of a frame: wait, or drop the frame if none was sent."""
        if sent:
            reader.keep(memoryview(data)[sent:])
        room = None
        while True:
            try:
                sent = sent or reader.write(data)
                if sent and (not reader.rest or reader.finish()):
                    return
            except OSError:
                self.drop(reader)
                return
            if not self.waits_for(reader):
                if sent:
                    self._unfinished.add(reader)
                else:
                    reader.dropped += 1
                return
            if room is None:
                room = select.poll()
                room.register(reader.end, select.POLLOUT)
            room.poll(POLL_INTERVAL)
            holds()

    def waits_for(self, reader: ReaderConnection) -> bool:
        """Whether a full buffer of this reader blocks the sender."""
        return not self._real and bool(reader.group)

    def tend(self) -> None:
        """Continue sending queued data."""
        for reader in tuple(self._unfinished):
            try:
                if reader.finish():
                    self._unfinished.remove(reader)
            except OSError:
                self.drop(reader)

    def _count(self, reader: ReaderConnection) -> None:
        if reader.dropped:
            self._notes[
                f"{reader.dropped} messages of group {self._group!r} were dropped: the buffer of {reader.name} was full"
            ] += 1
            reader.dropped = 0

    def notes(self) -> list[str]:
        """Notes on dropped messages and refused readers, after the last message."""
        for reader in self._readers:
            self._count(reader)
        return [text if count == 1 else f"{text} ({count} times)" for text, count in self._notes.items()]

    def close(self) -> None:
        """Close. The kernel delivers data already sent; queued data is sent within `FAREWELL`."""
        until = now() + FAREWELL
        while self._unfinished and now() < until:
            select.select([], [reader.end for reader in self._unfinished], [], FAREWELL * 1e-9)
            self.tend()
        for reader in tuple(self._readers):
            self.drop(reader)
        if self._listener is not None:
            self._outer.remove(self._watch.fileno())
            self._listener.close()
