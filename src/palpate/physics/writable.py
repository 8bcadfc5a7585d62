"""Checks that a file or a folder can be written, before its content is computed, and locks files."""

import contextlib
import errno
import os
import tempfile
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # not POSIX
    fcntl = None  # type: ignore[assignment]


def check_file(path: Path, *, folders: bool = True) -> None:
    """OSError: the file cannot be written. Leaves no file behind.

    folders  missing parent folders are allowed: the caller creates them later
    """
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "this is a folder, expected the name of a file")
        if path.is_file():
            with path.open("ab"):
                return
        if not path.exists():  # neither a pipe nor a terminal
            _check_room(path.parent, folders)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def check_folder(path: Path) -> None:
    """OSError: the folder cannot be created or written to. Leaves nothing behind."""
    try:
        _check_room(path, folders=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _check_room(folder: Path, folders: bool) -> None:
    """OSError: the folder, or with `folders` its nearest existing parent, cannot be written to."""
    while folders and not folder.exists() and folder != folder.parent:
        folder = folder.parent
    with tempfile.TemporaryFile(dir=folder):
        pass


def lock_file(file: IO[Any]) -> bool:
    """Lock a file exclusively until `unlock_file`, or until it is closed here and in all forked processes. False:
    another process holds the lock. Without POSIX nothing is locked."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno in (errno.ENOLCK, errno.EOPNOTSUPP):  # a file system without locks
            return True
        raise


def opened_alone(path: Path) -> IO[bytes] | None:
    """The file at this path, opened to append and locked; created if it does not exist. None: another process has
    locked it. OSError: it cannot be opened."""
    while True:
        opened = path.open("ab")
        if not lock_file(opened):
            opened.close()
            return None
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(opened.fileno()), os.stat(path)):
                return opened
        opened.close()  # another process removed this file before it was locked


def unlock_file(file: IO[Any]) -> None:
    """Release the lock of a file, also of copies of it in forked processes."""
    if fcntl is not None:
        with contextlib.suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_UN)
