"""Temporary folders that a later process removes if their process was killed."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from pathlib import Path

try:
    import fcntl
except ImportError:  # not POSIX: no leftovers are removed
    fcntl = None  # type: ignore[assignment]

_NAME = "palpate-"
_LOCK, _NEW = ".lock", ".lock.new"


class ScratchFolder(tempfile.TemporaryDirectory[str]):
    """A temporary folder `palpate-KIND-...`, removed when it is closed or its process ends.

    A killed process leaves its folder. So each folder has a lock file, which its process and the processes that it has
    forked hold until they end, and a new folder removes those of this user whose lock is free. A folder without a lock
    file, of another user, behind a link, or on a file system without locks is left alone.
    """

    def __init__(self, kind: str) -> None:
        remove_leftovers()
        super().__init__(prefix=f"{_NAME}{kind}-", ignore_cleanup_errors=True)
        self._lock, self._process = _locked(Path(self.name)), os.getpid()

    def cleanup(self) -> None:
        super().cleanup()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __del__(self) -> None:
        if getattr(self, "_process", None) == os.getpid():
            self.cleanup()
        elif hasattr(self, "_process"):  # a forked process drops its copy of this object
            self._finalizer.detach()  # type: ignore[attr-defined]


def _locked(folder: Path) -> int | None:
    """The locked lock file of a new folder. It gets its name when it is locked, so that no process finds it free."""
    if fcntl is None:
        return None
    number = os.open(folder / _NEW, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    with contextlib.suppress(OSError):  # a file system without locks: `remove_leftovers` cannot lock it either
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.rename(folder / _NEW, folder / _LOCK)
    return number


def remove_leftovers() -> list[Path]:
    """Remove the folders of killed processes of this user; returns them."""
    if fcntl is None:
        return []
    removed = []
    with contextlib.suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            if entry.name.startswith(_NAME) and _remove_if_free(entry):
                removed.append(Path(entry.path))
    return removed


def _remove_if_free(entry: os.DirEntry[str]) -> bool:
    """Remove a folder whose lock is free. The lock is held meanwhile, so that only one process removes it."""
    try:
        if not entry.is_dir(follow_symlinks=False) or entry.stat(follow_symlinks=False).st_uid != os.getuid():
            return False
        number = os.open(Path(entry.path) / _LOCK, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:  # no lock file: no folder of this kind, or one that is being made
        return False
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(entry.path, ignore_errors=True)
        return not os.path.lexists(entry.path)
    except OSError:  # in use, or a file system without locks
        return False
    finally:
        os.close(number)
