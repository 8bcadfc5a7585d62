"""How a stream gets from one process to another: by ZeroMQ, or by the local carrier of this machine.

A stream has one carrier, that of the group that sends it. Both keep the frames of a stream whole and in order; on the
simulated clock both hold back a sender that is far ahead, on the real clock both drop what has no room. A reader has
an inlet for each stream, so that it is woken by the one that it waits for and by no other: it needs no poller, and a
message that comes early wakes nobody.

zmq    a publisher a group and a subscriber an inlet; between machines, too
local  a pair of connected sockets for each stream and reading group, which the fork server makes before it forks the
       workers: it has no name, leaves no file, and nobody else can write to it. A message wakes its reader alone, where
       ZeroMQ wakes a thread of the sender and one of the reader before.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from collections.abc import Callable, Sequence

import zmq

HIGH_WATER = 20_000  # frames that ZeroMQ holds for a slow reader
PART = 1 << 16  # [bytes] of the parts in which the local carrier sends a frame
ROOM = 1 << 20  # [bytes] that wait in a pair, with the kernel's own for each frame; the system may permit less
LOOK = 20  # [ms] after which those who wait look round: for orders, and what else has come

Pair = tuple[socket.socket, socket.socket]
Pairs = dict[tuple[str, str], Pair]
"""By stream and reading group: the end to read from and the end to write to."""
_WHOLE, _MORE, _NEXT, _LAST = b"\0", b"\1", b"\2", b"\3"  # first byte of each part


def pair() -> Pair:
    """A new pair for the local carrier."""
    read, write = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    write.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
    return read, write


class ZmqInlet:
    """Reads one stream through ZeroMQ.

    wait  [ms] for which `wait` waits
    """

    def __init__(self, socket: zmq.Socket, stream: str, wait: int) -> None:
        topic = stream.encode() + b"\0"
        self.socket, self._skip = socket, len(topic)
        socket.set(zmq.RCVHWM, HIGH_WATER)
        socket.set(zmq.RCVTIMEO, wait)
        socket.set(zmq.RECONNECT_IVL, 5)
        socket.subscribe(topic)
        self._receive = socket.recv

    def take(self) -> bytes | None:
        """The payload of the next frame, if one has come."""
        try:
            return self._receive(zmq.NOBLOCK)[self._skip :]
        except zmq.Again:
            return None

    def wait(self) -> bytes | None:
        """The payload of the next frame; None where none comes in time."""
        try:
            return self._receive()[self._skip :]
        except zmq.Again:
            return None

    def forget(self) -> None:
        """Nothing has come before this process was there."""

    def close(self) -> None:
        """Close; the sender does not wait for this reader any more."""
        self.socket.close(linger=0)


class LocalInlet:
    """Reads one stream through the local carrier.

    exact  wait exactly as long as was asked for; else the kernel rounds up to its ticks (up to 10 ms), which saves a
           call for each message
    """

    def __init__(self, end: socket.socket, wait: int, exact: bool) -> None:
        self._end, self._receive, self._wait = end, end.recv, wait
        self._parts: list[bytes] = []
        self._poll = select.poll() if exact else None
        if self._poll is not None:
            self._poll.register(end.fileno(), select.POLLIN)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", 0, wait * 1000))

    def take(self) -> bytes | None:
        """The payload of the next frame, if one has come."""
        return self._next(socket.MSG_DONTWAIT)

    def wait(self) -> bytes | None:
        """The payload of the next frame; None where none comes in time."""
        if self._poll is None:
            return self._next(0)
        return self._next(socket.MSG_DONTWAIT) if self._poll.poll(self._wait) else None

    def _next(self, flags: int) -> bytes | None:
        while True:
            try:
                data = self._receive(PART, flags)
            except (BlockingIOError, InterruptedError):
                return None
            kind = data[:1]
            if kind == _WHOLE:
                return data[1:]
            if not kind:  # no writer is left
                return None
            if kind == _MORE:  # the rest of the one before was dropped
                self._parts.clear()
            elif not self._parts:  # its beginning was dropped
                continue
            self._parts.append(data[1:])
            if kind == _LAST:
                whole = b"".join(self._parts)
                self._parts.clear()
                return whole

    def forget(self) -> None:
        """Throw away what was sent to a predecessor."""
        while self.take() is not None:
            pass
        self._parts.clear()

    def close(self) -> None:
        """The sender does not wait for this reader any more."""
        with contextlib.suppress(OSError):
            self._end.shutdown(socket.SHUT_RD)


Inlet = ZmqInlet | LocalInlet


class LocalOutlet:
    """Sends one stream through the local carrier.

    ends   the ends to write to, one for each reading group
    holds  called again and again while a reader has no room, to look round (it may raise); None: a frame that finds no
           room is dropped
    """

    def __init__(self, ends: Sequence[socket.socket], holds: Callable[[], None] | None) -> None:
        self._ends, self._holds = list(ends), holds

    def send(self, payload: bytes) -> None:
        """Send the payload of one frame to all readers."""
        if len(payload) < PART:
            data = _WHOLE + payload
            for end in self._ends:
                try:
                    end.send(data, socket.MSG_DONTWAIT)
                except OSError as error:
                    self._trouble(end, data, error)
            return
        starts = range(0, len(payload), PART - 1)
        kinds = [_MORE, *[_NEXT] * (len(starts) - 2), _LAST]
        parts = [kind + payload[at : at + PART - 1] for kind, at in zip(kinds, starts, strict=True)]
        for end in list(self._ends):
            for data in parts:
                try:
                    end.send(data, socket.MSG_DONTWAIT)
                except OSError as error:
                    if not self._trouble(end, data, error):
                        break

    def _trouble(self, end: socket.socket, data: bytes, error: OSError) -> bool:
        """A reader that is gone, or far behind. Returns whether it has the data after all."""
        if not isinstance(error, BlockingIOError):
            self._ends = [other for other in self._ends if other is not end]
            return False
        if self._holds is None:
            return False
        room = select.poll()
        room.register(end.fileno(), select.POLLOUT)
        while True:
            # A reader that has ended meanwhile makes no room, and does not wake the poll: only a send tells.
            room.poll(LOOK)
            try:
                end.send(data, socket.MSG_DONTWAIT)
                return True
            except BlockingIOError:
                self._holds()
            except OSError:
                self._ends = [other for other in self._ends if other is not end]
                return False


class ZmqOutlet:
    """Sends the streams of a group through ZeroMQ to all who have subscribed.

    socket  a publisher, which on the simulated clock gives up after `LOOK` while a reader has no room
    holds   called again and again while that is so, to look round (it may raise)
    """

    def __init__(self, socket: zmq.Socket, holds: Callable[[], None]) -> None:
        # The plain send of the binding, without the layer that looks for multipart and tracking options.
        self._send = zmq.backend.Socket.send.__get__(socket)
        self._holds = holds

    def send(self, frame: bytes) -> None:
        """Send one frame."""
        while True:
            try:
                self._send(frame)
                return
            except zmq.Again:
                self._holds()
