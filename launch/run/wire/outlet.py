"""Where nodes of other groups read what a worker sends: ZMTP over a Unix socket, and libzmq to other machines.

A message is written by the thread that computes, one call a reader. Any ZeroMQ program of the same user may read, too.

A reader that has no room holds the sender back on the simulated clock, and loses the message on the real one. A frame
that the system has taken in part is finished before the next; only whole ones are dropped, and counted. Who is no
worker of the run holds nobody back: programs that only look on have an outlet of their own, which queues for each as
much as `QUEUE`. However many come and go, on the real clock one of them is served in each look at the sockets.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import islice

import zmq

from palpate.engine.clock import POLL_INTERVAL, now
from palpate.launch.run.wire.watch import SocketPoller
from palpate.launch.run.wire.zmtp import GREETING, GROUP, SUBSCRIBERS, Connection, ZmtpError, pong, subscription

ROOM = 1 << 20  # [bytes] that wait for a reader, with the kernel's own for each frame; the system may permit less
QUEUE = 4 << 20  # [bytes] that are queued for a reader which looks on
LONGEST_COMMAND = 1024  # [bytes] of what a reader may send at once
FAREWELL = 200_000_000  # [ns] for readers to take what is queued for them
MOST_BUFFERS = 1000  # of one call; the system takes 1024
_NOW = socket.MSG_DONTWAIT
_SHORT = tuple(bytes((0, size)) for size in range(256))  # how a frame of a message begins, by its size


def _framed(data: bytes) -> bytes:
    """A message as a frame."""
    size = len(data)
    return (_SHORT[size] if size <= 255 else b"\2" + size.to_bytes(8, "big")) + data


class ReaderConnection:
    """A connection to a reader. `rest` is what is still to be sent: of a frame that was sent in part, and for one that
    looks on the frames behind it, `queued` bytes in all."""

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
        """For people."""
        return f"group {self.group!r}" if self.group else f"process {self.pid}"

    def write(self, data: bytes) -> int:
        """Send a frame; returns how many of its bytes were taken. OSError: the reader is gone."""
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
        """Send this later."""
        self.rest.append(data)
        self.queued += len(data)

    def finish(self) -> bool:
        """Send of what is left as much as there is room for; returns whether nothing is left. OSError: the reader is
        gone."""
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

    far    where readers on other machines hear it; None: there are none
    holds  called again and again while a reader has no room, to look round (it may raise)
    """

    def __init__(self, outlet: Outlet, stream: str, far: zmq.Socket | None, holds: Callable[[], None]) -> None:
        self.topic = stream.encode() + b"\0"
        self.readers: tuple[ReaderConnection, ...] = ()
        self._outlet, self._holds = outlet, holds
        # The plain send of the binding, without the layer that looks for multipart and tracking options.
        self._far = None if far is None else zmq.backend.Socket.send.__get__(far)

    def send(self, payload: bytes) -> None:
        """Send one message to all readers."""
        topic = self.topic
        data = _framed(topic + payload)
        size = len(data)
        for reader in self.readers:
            sent = 0
            try:
                if not reader.rest:
                    sent = reader.send(data, _NOW)
            except BlockingIOError:
                pass
            except OSError:
                self._outlet.drop(reader)
                continue
            if sent != size:
                self._outlet.crowded(reader, data, sent, self._holds)
        while self._far is not None:
            try:
                self._far(topic + payload)
                return
            except zmq.Again:
                self._holds()


class Outlet:
    """Listens for readers and knows what each of them reads.

    group     name of the worker
    external  streams that it sends, and the groups that read each
    real      whether it is the real clock: nobody waits for a slow reader
    watch     where the sockets are watched
    """

    def __init__(self, group: str, external: Mapping[str, Collection[str]], real: bool, watch: SocketPoller) -> None:
        self.foreign = 0  # readers that were refused
        self.changed = False  # whether a reader has come, gone, or subscribed to something else
        self._group, self._external, self._real, self._outer = group, external, real, watch
        self._watch = SocketPoller()
        watch.add(self._watch.fileno(), partial(self._watch.poll, most=1 if real else 64))
        self._workers = {name for groups in external.values() for name in groups}
        self._senders: list[Sender] = []
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._readers: dict[ReaderConnection, None] = {}
        self._unfinished: set[ReaderConnection] = set()
        self._notes: Counter[str] = Counter()

    def bind(self, path: str) -> None:
        """Listen there. OSError: that cannot be."""
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)  # a predecessor's
        self._listener.bind(path)
        self._listener.listen(64)
        self._listener.setblocking(False)
        self._watch.add(self._listener.fileno(), self._accept)

    def sender(self, stream: str, far: zmq.Socket | None, holds: Callable[[], None]) -> Sender:
        """Where a stream is sent."""
        self._senders.append(Sender(self, stream, far, holds))
        self._sort()
        return self._senders[-1]

    def linked(self, stream: str) -> int:
        """How many groups read a stream here."""
        topic = stream.encode() + b"\0"
        return len({reader.group for reader in self._readers if reader.group and reader.topics[topic]})

    def heard(self, topic: bytes) -> bool:
        """Whether anybody reads a stream here."""
        return any(topic.startswith(tuple(reader.topics)) for reader in self._readers)

    def publish(self, messages: Sequence[bytes]) -> None:
        """Send messages, each after the name of its stream and a zero byte, to all who look on: one call for each. What
        does not fit into the reader's queue is dropped."""
        for reader in tuple(self._readers):
            topics = tuple(reader.topics)
            for data in messages:
                if data.startswith(topics):
                    if reader.queued and reader.queued + len(data) > QUEUE:
                        reader.dropped += 1
                    else:
                        reader.keep(_framed(data))
            if reader.rest:
                self._unfinished.add(reader)
        self.tend()

    # -- readers -------------------------------------------------------------------------------------------------

    def _accept(self) -> None:
        try:
            end = self._listener.accept()[0]
        except OSError:  # who came has gone again, or there are no descriptors left
            return
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
        reader = ReaderConnection(end, self._group)
        self._readers[reader] = None
        self._watch.add(end.fileno(), lambda: self._serve(reader))
        with contextlib.suppress(OSError):
            reader.write(GREETING)

    def _serve(self, reader: ReaderConnection) -> None:
        """Take what a reader has sent: who it is, and what it wants to read."""
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
            self._refuse(reader, str(error))
        except OSError:
            self.drop(reader)

    def _handle_frame(self, reader: ReaderConnection, flags: int, body: bytes) -> None:
        wanted = subscription(flags, body)
        if wanted is not None:
            comes, topic = wanted
            reader.topics[topic] += 1 if comes else -1
            if reader.topics[topic] <= 0:
                del reader.topics[topic]
            self._sort()
        elif (answer := pong(flags, body)) is not None:
            reader.write(answer)
        elif flags == 0:
            self.foreign += 1

    def _sort(self) -> None:
        """Who reads which stream. A subscription is the beginning of the name of one, or of several."""
        self.changed = True
        for sender in self._senders:
            sender.readers = tuple(
                reader for reader in self._readers if any(sender.topic.startswith(topic) for topic in reader.topics)
            )

    def _refuse(self, reader: ReaderConnection, why: str) -> None:
        self.foreign += 1
        self._notes[f"a reader of group {self._group!r} was refused, {reader.name}: {why}"] += 1
        self.drop(reader)

    def drop(self, reader: ReaderConnection) -> None:
        """A reader is gone, or has to go."""
        if reader not in self._readers:
            return
        del self._readers[reader]
        self._unfinished.discard(reader)
        self._count(reader)
        self._watch.remove(reader.end.fileno())
        reader.end.close()
        self._sort()

    # -- time and room -------------------------------------------------------------------------------------------

    def crowded(self, reader: ReaderConnection, data: bytes, sent: int, holds: Callable[[], None]) -> None:
        """A reader has taken so many bytes of a frame and has no room for the rest."""
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
            if self._real or not reader.group:
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

    def tend(self) -> None:
        """Go on with what could not be finished."""
        for reader in tuple(self._unfinished):
            try:
                if reader.finish():
                    self._unfinished.remove(reader)
            except OSError:
                self.drop(reader)

    def _count(self, reader: ReaderConnection) -> None:
        if reader.dropped:
            self._notes[
                f"{reader.dropped} messages of group {self._group!r} were dropped: {reader.name} had no room"
            ] += 1
            reader.dropped = 0

    def notes(self) -> list[str]:
        """What there is to say of the readers, once all is sent."""
        for reader in self._readers:
            self._count(reader)
        return [text if count == 1 else f"{text} ({count} times)" for text, count in self._notes.items()]

    def close(self) -> None:
        """Close; what was sent is delivered by the system, and what is queued as far as readers take it at once."""
        until = now() + FAREWELL
        while self._unfinished and now() < until:
            select.select([], [reader.end for reader in self._unfinished], [], FAREWELL * 1e-9)
            self.tend()
        for reader in tuple(self._readers):
            self.drop(reader)
        self._outer.remove(self._watch.fileno())
        self._listener.close()
