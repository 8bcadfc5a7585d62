"""One run at a time writes the file of a recording, and overwrites nothing but a recording."""

import contextlib
import os
import stat
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from palpate.physics.errors import ArgumentError, RunError
from palpate.physics.writable import opened_alone, unlock_file
from palpate.records.format.head import PROFILE
from palpate.records.format.mcap_writer import MAGIC

_HEADER = struct.Struct("<BQI")  # kind and length of the first record, and length of the profile in it


def is_recording(file: Path) -> bool:
    """Whether a file begins as a recording of palpate, which may be truncated after its header."""
    with open(file, "rb") as opened:
        begin = opened.read(len(MAGIC) + _HEADER.size + len(PROFILE))
    return begin.startswith(MAGIC) and begin[len(MAGIC) + _HEADER.size :] == PROFILE.encode()


@contextlib.contextmanager
def claim_file(file: Path, force: bool = False) -> Iterator[bool]:
    """Keep the file of a recording for this process, under an exclusive lock of the file itself. Yields whether the
    file is new; a new file that stays empty is removed.

    force  overwrite any file, also through a link

    ArgumentError: the file exists and is not a recording. RunError: another process writes it. OSError: the file
    cannot be written.
    """
    if not force:
        _check_content(file)
    with contextlib.suppress(FileNotFoundError):  # one look: another run may remove the file between two
        if not stat.S_ISREG(file.stat().st_mode):
            raise ArgumentError(f"recording {file}: found a device, a pipe or a folder, expected the name of a file")
    file.parent.mkdir(parents=True, exist_ok=True)
    fresh = not file.exists()
    opened = _lock_file(file)
    try:
        if not force:
            _check_content(file)  # another program may have written it meanwhile
        yield fresh
    finally:
        if fresh:
            with contextlib.suppress(OSError):
                if not file.stat().st_size:
                    file.unlink()
        unlock_file(opened)
        opened.close()


def _check_content(file: Path) -> None:
    """ArgumentError: the file exists, and is not an empty file or a recording."""
    cure = "expected a new file or a recording; choose another name, or overwrite it with --force (force=True)"
    if file.is_symlink():
        raise ArgumentError(f"recording {file}: found a link to {os.readlink(file)}, {cure}")
    with contextlib.suppress(FileNotFoundError):  # also one that another run removes now
        if not file.is_file() or not file.stat().st_size or is_recording(file):
            return
        raise ArgumentError(f"recording {file}: found a file that is not a recording of palpate, {cure}")


def _lock_file(file: Path) -> IO[bytes]:
    """The file at this path, locked. RunError: another process has locked it."""
    opened = opened_alone(file)
    if opened is None:
        raise RunError(
            f"recording {file}: another run is writing this file; choose another name with --record FILE, or wait"
        )
    return opened
