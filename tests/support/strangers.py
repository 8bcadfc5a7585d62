"""The listening sockets of a process and its children, and their answers to another user."""

import contextlib
import os
import socket
import struct
from pathlib import Path
from typing import NamedTuple

from random_faults import below

NOBODY = 65534  # uid and gid of the user `nobody`
PROBE = b"GET /info/main/workers.html HTTP/1.0\r\n\r\n"


class Listening(NamedTuple):
    """A socket: AF_INET, AF_INET6 or AF_UNIX, SOCK_STREAM or SOCK_DGRAM, and address and port, or its path."""

    family: int
    kind: int
    address: str
    port: int = 0


def listening(pid: int) -> list[Listening]:
    """Sockets that others can connect or send to."""
    inodes = set()
    for each in (pid, *below(pid)):
        with contextlib.suppress(OSError):
            for link in Path(f"/proc/{each}/fd").iterdir():
                with contextlib.suppress(OSError):
                    inodes.add(os.readlink(link).removeprefix("socket:[").removesuffix("]"))
    found = []
    for name, family, kind in (
        ("tcp", socket.AF_INET, socket.SOCK_STREAM), ("tcp6", socket.AF_INET6, socket.SOCK_STREAM),
        ("udp", socket.AF_INET, socket.SOCK_DGRAM), ("udp6", socket.AF_INET6, socket.SOCK_DGRAM),
    ):  # fmt: skip
        for row in _rows(name):
            local, remote, state, inode = row[1], row[2], row[3], row[9]
            open_to_all = state == "0A" or (kind == socket.SOCK_DGRAM and remote.endswith(":0000"))
            if inode in inodes and open_to_all:
                words, port = local.split(":")
                raw = b"".join(struct.pack("<I", int(words[k : k + 8], 16)) for k in range(0, len(words), 8))
                found.append(Listening(family, kind, socket.inet_ntop(family, raw), int(port, 16)))
    for row in _rows("unix"):
        dgram, listens = int(row[4], 16) == 2, int(row[3], 16) & 0x10000
        if row[6] in inodes and len(row) > 7 and (dgram or listens):
            found.append(
                Listening(socket.AF_UNIX, socket.SOCK_DGRAM if dgram else socket.SOCK_STREAM, row[7].replace("@", "\0"))
            )
    return found


def _rows(name: str) -> list[list[str]]:
    return [line.split() for line in Path("/proc/net", name).read_text().splitlines()[1:]]


def answer(to: Listening, request: bytes = PROBE) -> bytes:
    """The answer of a socket to a request of another user's process; "in" if a named socket accepts it. Without root
    rights: to a process of this user without the key."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            if os.getuid() == 0:
                os.setgroups([])
                os.setgid(NOBODY)
                os.setuid(NOBODY)
            os.write(theirs, _said(to, request))
        finally:
            os._exit(0)
    os.close(theirs)
    with open(ours, "rb") as printed:
        received = printed.read()
    os.waitpid(child, 0)
    return received


def _said(to: Listening, request: bytes) -> bytes:
    with socket.socket(to.family, to.kind) as end:
        end.settimeout(2.0)
        try:
            if to.family == socket.AF_UNIX:
                end.connect(to.address)
                return b"in"
            here = {"0.0.0.0": "127.0.0.2", "::": "::1"}.get(to.address, to.address)
            end.connect((here, to.port))
            if to.kind == socket.SOCK_STREAM:
                with contextlib.suppress(TimeoutError):
                    if received := end.recv(100):
                        return received
            end.send(request)
            return end.recv(100)
        except OSError:
            return b""
