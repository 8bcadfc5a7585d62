"""Short datagrams of another program of this user: through a datagram socket at a path, or where the system has none,
as Windows, through a file at this path, which holds the last one."""

import contextlib
import os
import socket
import stat
import struct
import zlib
from pathlib import Path

LONGEST = 512  # [bytes] of a datagram
MOST = 64  # datagrams read at once, so that a flood of them does not block the reader
_HEAD = struct.Struct("<8sIH")  # mark of the file, CRC-32 and length of the datagram
_MARK = b"palpate\n"


class _SocketInbox:
    def __init__(self, path: str) -> None:
        with contextlib.suppress(FileNotFoundError):
            if not stat.S_ISSOCK(os.lstat(path).st_mode):
                raise FileExistsError("a file that is not a socket exists there")
            os.unlink(path)
        self._path, self._socket = path, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.bind(path)
            os.chmod(path, 0o600)
        except OSError:
            self._socket.close()
            raise

    def read(self) -> list[bytes]:
        found = list[bytes]()
        with contextlib.suppress(BlockingIOError):
            while len(found) < MOST:
                found.append(self._socket.recv(LONGEST))
        return found

    def close(self) -> None:
        self._socket.close()
        with contextlib.suppress(OSError):
            os.unlink(self._path)


class _FileInbox:
    def __init__(self, path: str) -> None:
        with contextlib.suppress(FileNotFoundError):
            with open(path, "rb") as former:
                if former.read(len(_MARK)) != _MARK:
                    raise FileExistsError("another file exists there")
            os.unlink(path)
        self._path, self._last = path, _HEAD.pack(_MARK, 0, 0)
        number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
        self._file = open(number, "r+b", buffering=0)  # noqa: SIM115
        self._file.write(self._last)

    def read(self) -> list[bytes]:
        """The datagram, if there is a new one that is complete."""
        self._file.seek(0)
        data = self._file.read(_HEAD.size + LONGEST) or b""
        if data == self._last or len(data) < _HEAD.size:
            return []
        _, check, size = _HEAD.unpack_from(data)
        datagram = data[_HEAD.size : _HEAD.size + size]
        if zlib.crc32(datagram) != check:  # it is being written
            return []
        self._last = data
        return [datagram]

    def close(self) -> None:
        self._file.close()
        with contextlib.suppress(OSError):
            os.unlink(self._path)


Inbox = _SocketInbox | _FileInbox


def open_inbox(path: str) -> Inbox:
    """Receive datagrams at this path, of this user only. OSError: the path cannot be used."""
    return _SocketInbox(path) if hasattr(socket, "AF_UNIX") else _FileInbox(path)


class Outbox:
    """Sends datagrams; one without a receiver at its path is lost."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        if hasattr(socket, "AF_UNIX"):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    def send(self, path: Path, datagram: bytes) -> None:
        with contextlib.suppress(OSError):
            if self._socket is not None:
                self._socket.sendto(datagram, str(path))
                return
            with path.open("r+b", buffering=0) as file:
                file.write(_HEAD.pack(_MARK, zlib.crc32(datagram), len(datagram)) + datagram)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
