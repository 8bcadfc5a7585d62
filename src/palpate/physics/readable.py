"""Checks of a file before it is read: a pipe or a device may never end, and a size may only be claimed."""

import errno
import hashlib
import os
import stat
from pathlib import Path

DATA = (".stl", ".ply", ".obj", ".npz", ".csv")  # endings of data that nodes read; keys and credentials have others
MOST_TEXT = 1 << 28  # [bytes] of a file that is read into memory as text: 100 times the largest that palpate writes


def check_readable(path: str | Path, most: int | None = None) -> None:
    """OSError: missing, a pipe or a device, or longer than `most` [bytes]."""
    found = os.stat(path)
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OSError(errno.EINVAL, "a pipe or a device, expected a file", str(path))
    if most is not None and found.st_size > most:
        raise OSError(errno.EFBIG, f"{found.st_size} bytes, expected at most {most}", str(path))


def check_file(path: str | Path, most: int | None = None) -> int:
    """Size of a regular file [bytes]. OSError: as `check_readable`, or a folder."""
    check_readable(path, most)
    found = os.stat(path)
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "a folder, expected a file", str(path))
    return found.st_size


def short_hash(data: bytes) -> str:
    """Hash of a content, by which files are compared: the first 64 bits of SHA-256."""
    return hashlib.sha256(data).hexdigest()[:16]


def hash_of_file(path: str | Path) -> str:
    """`short_hash` of a file; "": there is no regular file that can be read."""
    try:
        if not Path(path).is_file():
            return ""
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:16]
    except (OSError, ValueError):
        return ""
