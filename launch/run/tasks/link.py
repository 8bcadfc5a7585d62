"""The connection of a process to one that it starts: an unnamed pipe that the new process inherits.

On Windows, where `subprocess` passes on no such pipe, it is TCP on loopback. The new process reads two secrets from its
standard input, sends the first one, and accepts work only from who answers with the second one: its parent may have
ended, and another user may listen at this port now.
"""

import contextlib
import hmac
import os
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

LOOPBACK = "127.0.0.1"
STARTS = 120.0  # [s] Timeout of the start of the process
SECRET = 32  # [bytes] of each of the two
HEARD = 2.0  # [s] within which who connects sends the secret
TURN = 0.1  # [s] Time after which the start looks whether the process has ended


def open_link(command: Sequence[str], **given: Any) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a process that calls `join_link` with the argument that is added to its command, and its connection.
    If it ends or does not connect within `STARTS`, the connection is at its end. `given`: arguments of `Popen`."""
    if not hasattr(os, "fork"):
        return _over_tcp(command, **given)
    ours, theirs = Pipe()
    with theirs:
        process = subprocess.Popen(
            [*command, str(theirs.fileno())], stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], **given
        )
    return process, ours


def _over_tcp(command: Sequence[str], **given: Any) -> tuple[subprocess.Popen[bytes], Connection]:
    until, first, second = time.monotonic() + STARTS, secrets.token_bytes(SECRET), secrets.token_bytes(SECRET)
    with socket.create_server((LOOPBACK, 0)) as server:
        address = f"{LOOPBACK}:{server.getsockname()[1]}"
        process = subprocess.Popen([*command, address], stdin=subprocess.PIPE, **given)
        assert process.stdin is not None
        with contextlib.suppress(OSError), process.stdin:  # it has ended
            process.stdin.write(first + second)
        server.settimeout(TURN)
        while process.poll() is None and time.monotonic() < until:
            try:
                client = server.accept()[0]
            except TimeoutError:
                continue
            client.settimeout(HEARD)
            try:
                known = hmac.compare_digest(_read(client), first)
                if known:
                    client.sendall(second)
            except OSError:
                known = False
            if known:
                client.settimeout(None)
                return process, Connection(client.detach())
            client.close()
    process.kill()
    ours, theirs = Pipe()
    theirs.close()
    return process, ours


def _read(client: socket.socket) -> bytes:
    """The secret, or the part that was sent before the connection closed."""
    data = b""
    while len(data) < SECRET and (more := client.recv(SECRET - len(data))):
        data += more
    return data


def join_link(argument: str) -> Connection:
    """The connection of this process to the one that has started it by `open_link`. ConnectionError: another one
    answered."""
    if argument.isdecimal():
        return Connection(int(argument))
    host, port = argument.split(":")
    client = socket.create_connection((host, int(port)))
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    client.settimeout(STARTS)
    client.sendall(sys.stdin.buffer.read(SECRET))
    if not hmac.compare_digest(_read(client), sys.stdin.buffer.read(SECRET)):
        raise ConnectionError(f"{argument}: another process answered than the one that started this one")
    client.settimeout(None)
    return Connection(client.detach())
