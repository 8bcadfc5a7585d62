"""Inlets: the nodes of a worker read each stream of another group through one inlet.

A separate socket per stream means that only the awaited stream wakes a reader.

Inlet     from a worker on this machine: ZMTP over a Unix socket, read by the computing thread, one call per message
TcpInlet  from a worker on another machine: libzmq's subscriber
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import time
from collections.abc import Callable

import zmq

from palpate.engine.clock import POLL_INTERVAL, now
from palpate.launch.run.wire import zmtp
from palpate.launch.run.wire.watch import SocketPoller

CHUNK = 1 << 16  # [bytes] read in one call
LONGEST_MESSAGE = 1 << 28  # [bytes]
LONGEST_FRAME = LONGEST_MESSAGE + 1024  # [bytes] with the name of its stream
RETRY = 5_000_000  # [ns] between two attempts to connect
HIGH_WATER = 20_000  # frames that libzmq buffers for a slow reader


class Inlet:
    """Reads one stream of a worker on this machine.

    group  name of the worker that reads
    watch  poller of the socket
    ready  called when there is something to read
    apart  the set of inlets without a connection
    """

    def __init__(
        self, stream: str, group: str, watch: SocketPoller, ready: Callable[[Inlet], None], apart: set[Inlet]
    ) -> None:
        self.stream = stream
        self.linked = False  # whether the subscription was sent
        self._topic = stream.encode() + b"\0"
        self._group, self._watch, self._ready, self._apart = group, watch, ready, apart
        self._path = ""
        self._socket: socket.socket | None = None
        self._tried = -RETRY
        self._many = False  # whether the next frame belongs to a multipart message
        self._between = False  # whether the next byte begins a frame

    def connect(self, path: str) -> None:
        """Connect to the outlet at this path, and retry until it listens."""
        self._path = path
        self._apart.add(self)
        self.reach()

    def reach(self) -> None:
        if now() - self._tried < RETRY:
            return
        self._tried = now()
        end = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection = zmtp.Connection(b"SUB", zmtp.PUBLISHERS, LONGEST_FRAME, self._group)
        try:
            end.setblocking(False)
            end.connect(self._path)
            end.send(zmtp.GREETING + connection.ready)
        except OSError:  # the outlet does not listen yet
            end.close()
            return
        end.setblocking(True)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", 0, POLL_INTERVAL * 1000))
        self._socket, self._receive = end, end.recv
        self._connection = connection
        self._many = self._between = False
        self._apart.discard(self)
        self._watch.add(end.fileno(), lambda: self._ready(self))

    def wait(self) -> list[bytes]:
        """The next payloads; empty if none arrives within about `POLL_INTERVAL`."""
        if self._socket is None:
            time.sleep(POLL_INTERVAL * 1e-3)
            return []
        return self._read(0)

    def wait_until(self, deadline: int) -> list[bytes]:
        """The next payloads; empty if none arrives before the deadline [ns]."""
        left = max(0, deadline - now()) * 1e-9
        if self._socket is None:
            time.sleep(left)
            return []
        return self._read(socket.MSG_DONTWAIT) if select.select([self._socket], [], [], left)[0] else []

    def take(self) -> list[bytes]:
        return [] if self._socket is None else self._read(socket.MSG_DONTWAIT)

    def lend(self) -> tuple[int, bytes]:
        """Let compiled code read the connection (`launch.run.hop`). Returns its descriptor, -1 while it is not
        established, and the received bytes of the beginning of a frame."""
        if self._socket is None or not self.linked or self._many:
            return -1, b""
        rest = bytes(self._connection.decoder.rest)
        self._connection.decoder.rest.clear()
        return self._socket.fileno(), rest

    def resume(self, data: bytes) -> list[bytes]:
        """Continue after received bytes that compiled code has not read; the payloads in them."""
        if self._socket is None:
            return []
        try:
            return self._payloads(data)
        except zmtp.ZmtpError:
            self._drop()
            return []

    def _read(self, flags: int) -> list[bytes]:
        try:
            data = self._receive(CHUNK, flags)
        except (BlockingIOError, InterruptedError):
            return []
        except OSError:
            data = b""
        if not data:  # the writer has closed the connection; everything before was read
            self._drop()
            return []
        if (
            data[0] == 0
            and len(data) > 1
            and len(data) == 2 + data[1]
            and data.startswith(self._topic, 2)
            and self._between
        ):
            return [data[2 + len(self._topic) :]]  # fast path: exactly one short message
        try:
            return self._payloads(data)
        except zmtp.ZmtpError:
            self._drop()
            return []

    def _payloads(self, data: bytes) -> list[bytes]:
        """The payloads that these bytes complete. ZmtpError: not ZMTP."""
        payloads = []
        for kind, body in self._connection.feed(data):
            if kind == 0 and body.startswith(self._topic) and not self._many:
                payloads.append(body[len(self._topic) :])
            else:
                self._other(kind, body)
        if not self.linked:
            self._link()
        self._between = self.linked and not self._many and not self._connection.decoder.rest
        return payloads

    def _link(self) -> None:
        """Subscribe as soon as the writer is ready."""
        assert self._socket is not None
        if self._connection.peer is None:
            return
        old = self._connection.minor == 0
        with contextlib.suppress(OSError):
            self._socket.send(zmtp.frame(b"\1" + self._topic) if old else zmtp.command(b"SUBSCRIBE", self._topic))
        self.linked = True

    def _other(self, kind: int, body: bytes) -> None:
        """Answer a ping; other streams and multipart messages are dropped."""
        assert self._socket is not None
        answer = zmtp.pong(kind, body)
        if answer is not None:
            with contextlib.suppress(OSError):
                self._socket.send(answer, socket.MSG_DONTWAIT)
        elif kind != zmtp.COMMAND:
            self._many = kind == zmtp.MORE

    @property
    def awaits_writer(self) -> bool:
        """Whether the connection to the writer is not ready yet."""
        return bool(self._path) and not self.linked

    def _drop(self) -> None:
        self.close()
        self._apart.add(self)

    def close(self) -> None:
        """Close; the sender does not wait for this reader any more."""
        if self._socket is not None:
            self._watch.remove(self._socket.fileno())
            self._socket.close()
        self._socket, self.linked = None, False


class TcpInlet:
    """Reads one stream of a worker on another machine."""

    awaits_writer = False

    def __init__(self, socket: zmq.Socket, stream: str) -> None:
        topic = stream.encode() + b"\0"
        self.stream, self.socket, self._skip = stream, socket, len(topic)
        socket.set(zmq.RCVHWM, HIGH_WATER)
        socket.set(zmq.MAXMSGSIZE, LONGEST_FRAME)
        socket.set(zmq.RCVTIMEO, POLL_INTERVAL)
        socket.set(zmq.RECONNECT_IVL, 5)
        socket.subscribe(topic)

    def wait(self) -> list[bytes]:
        """The next payload; empty if none arrives within `POLL_INTERVAL`."""
        try:
            return [self.socket.recv()[self._skip :]]
        except zmq.Again:
            return []

    def wait_until(self, deadline: int) -> list[bytes]:
        """The next payload; empty if none arrives before the deadline [ns], rounded up to 1 ms."""
        return self.take() if self.socket.poll(max(1, -((now() - deadline) // 1_000_000))) else []

    def take(self) -> list[bytes]:
        payloads = []
        with contextlib.suppress(zmq.Again):
            while True:
                payloads.append(self.socket.recv(zmq.NOBLOCK)[self._skip :])
        return payloads

    def close(self) -> None:
        """Close; the sender does not wait for this reader any more."""
        self.socket.close(linger=0)
