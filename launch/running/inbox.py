"""The inbox of a worker: what the other workers of the same machine write their messages to.

A message through ZeroMQ wakes a thread of the sender and a thread of the reader before it wakes the reader; one that is
written to the reader's inbox wakes the reader alone. An inbox is a pair of connected sockets, which the fork server
makes before it forks the workers: it has no name, leaves no file, and nobody else can write to it.

ZeroMQ carries all else: what comes from other machines, for observers and from the launcher, and the frames that an
inbox does not take, because they are too large or its reader is far behind. The reader takes from both in turns.
"""

from __future__ import annotations

import os
import select
import socket
from collections.abc import Sequence

import zmq

LARGEST = 1 << 16  # [bytes] of a frame that an inbox takes
ROOM = 1 << 20  # [bytes] that wait in an inbox, with the kernel's own for each frame; the system may permit less

Box = socket.socket  # the end of an inbox to write to
Pair = tuple[socket.socket, Box]


def pair() -> Pair:
    """A new inbox: the end to read from and the end to write to. The kernel keeps frames whole and in order."""
    read, write = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    write.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
    for end in (read, write):
        end.setblocking(False)
    return read, write


def post(boxes: Sequence[Box], data: bytes) -> bool:
    """Write a frame to inboxes, without waiting. Returns whether all have taken it."""
    taken = True
    for box in boxes:
        try:
            box.send(data)
        except OSError:  # full, or the system permits less than `LARGEST`
            taken = False
    return taken


class Inbox:
    """The reader's side: its inbox and a ZeroMQ socket.

    read      the end to read from
    heard     a ZeroMQ socket that receives
    patience  [ms] after which a blocking receive gives up once
    """

    def __init__(self, read: socket.socket, heard: zmq.Socket, patience: int) -> None:
        self._number, self._heard, self._patience = read.fileno(), heard, patience
        self._poll = select.poll()
        self._poll.register(self._number, select.POLLIN)
        self._poll.register(heard, select.POLLIN)
        self._more = True
        """ZeroMQ may hold frames: its descriptor only tells that something has changed."""
        self._turn = True
        """It is ZeroMQ's turn."""

    def receive(self, block: bool) -> bytes | None:
        """The next frame; None when none has come."""
        if self._more and self._turn:
            self._turn = False
            data = self._sent()
            if data is not None:
                return data
        ready = self._poll.poll(self._patience if block and not self._more else 0)
        written = bool(ready) and ready[0][0] == self._number
        self._more = self._more or len(ready) > written
        self._turn = True
        if written:
            return self._written()
        return self._sent() if self._more else None

    def clear(self) -> None:
        """Throw away what has been written."""
        while self._written() is not None:
            pass

    def waiting(self) -> bool:
        """Whether a frame may have come."""
        return self._more or bool(self._poll.poll(0))

    def _sent(self) -> bytes | None:
        try:
            return self._heard.recv(zmq.NOBLOCK)
        except zmq.Again:
            self._more = False
            return None

    def _written(self) -> bytes | None:
        try:
            return os.read(self._number, LARGEST)
        except BlockingIOError:
            return None
