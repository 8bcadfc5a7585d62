"""Checks of a file before it is read: a pipe or a device may never end, and a size may only be claimed."""

import errno
import os
import stat
from pathlib import Path

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
