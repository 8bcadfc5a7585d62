"""Which files of a cache are read: those that only this user or root can have written.

Compiled kernels are pickles, which can run any code; bases and results change forces. Folder and file must belong to
this user or to root, must not be writable by others, and must be no symbolic links.
"""

import contextlib
import errno
import functools
import os
import stat
import warnings
from collections.abc import Iterator
from pathlib import Path

OTHERS = stat.S_IWGRP | stat.S_IWOTH  # write access for others; a POSIX access list shows in the bits of the group
NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | NO_LINK
_FILE = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | NO_LINK
REMEDY = "Remove it, or set XDG_CACHE_HOME"
_RELATIVE = os.open in os.supports_dir_fd  # not on Windows, where user folders have access lists


class UntrustedError(OSError):
    """A file or folder that another user can have written."""


def check_trust(found: os.stat_result, *, sticky: bool = False, source: os.stat_result | None = None) -> None:
    """UntrustedError: belongs to a user other than this one and root, or others may write to it.

    sticky  allow a folder such as /tmp, in which users can create files but not replace those of others
    source  a source file of the same installation: who can write it runs code here in any case
    """
    if not hasattr(os, "geteuid"):
        return
    like = source is not None and (found.st_uid, found.st_gid) == (source.st_uid, source.st_gid)
    if like and not found.st_mode & ~source.st_mode & OTHERS:  # type: ignore[union-attr]
        return
    if found.st_uid not in (0, user := os.geteuid()):
        raise UntrustedError(f"belongs to user {found.st_uid}, expected {f'{user} or ' if user else ''}root")
    if found.st_mode & OTHERS and not (sticky and found.st_mode & stat.S_ISVTX):
        raise UntrustedError(f"other users may write to it (mode {stat.S_IMODE(found.st_mode):o}; chmod go-w)")


@contextlib.contextmanager
def open_trusted(folder: Path, source: os.stat_result | None = None) -> Iterator[int | None]:
    """The descriptor of a trusted folder; None where the system has none. OSError: missing, a link or untrusted."""
    if not _RELATIVE:
        yield None
        return
    descriptor = os.open(folder, _FOLDER)
    try:
        check_trust(os.fstat(descriptor), source=source)
        yield descriptor
    finally:
        os.close(descriptor)


def check_folder(folder: Path) -> None:
    """OSError: the folder is missing, a symbolic link or untrusted."""
    if folder.is_symlink():
        raise UntrustedError("is a symbolic link, expected a folder")
    with open_trusted(folder):
        pass


def open_in(folder: Path, name: str, at: int | None, flags: int = _FILE) -> int:
    """The descriptor of a file in a folder with this descriptor."""
    return os.open(folder / name, flags, 0o644) if at is None else os.open(name, flags, 0o644, dir_fd=at)


def user_cache() -> Path:
    """palpate's folder in the user's cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "palpate"


def make_folder(folder: Path) -> None:
    """Create a folder of the cache to which others may not write. OSError: not possible, or it exists and is
    untrusted."""
    for each in (user_cache(), folder):  # with a umask of 002, the group could write to what `mkdir` makes by default
        each.mkdir(0o755, parents=True, exist_ok=True)
    try:
        check_folder(folder)
    except UntrustedError as error:
        raise UntrustedError(errno.EPERM, f"{error}. {REMEDY}", str(folder)) from None


def may_read(path: Path) -> bool:
    """Whether a file of the cache exists and is trusted. A warning reports one that is not trusted."""
    if path.is_symlink() or path.parent.is_symlink():
        return _trust_error(path, "is a symbolic link")
    try:
        with open_trusted(path.parent) as at:
            descriptor = open_in(path.parent, path.name, at)
            try:
                check_trust(found := os.fstat(descriptor))
            finally:
                os.close(descriptor)
            return stat.S_ISREG(found.st_mode)
    except FileNotFoundError:
        return False
    except OSError as error:
        return _trust_error(path, str(error) if isinstance(error, UntrustedError) else f"cannot be opened: {error}")


def _trust_error(path: Path, why: str) -> bool:
    warn(f"{path} is not read: it or its folder {why}. {REMEDY}")
    return False


@functools.cache
def warn(text: str) -> None:
    """Warn once, in one line: a source line would follow the name of a file."""
    warnings.warn_explicit(text, RuntimeWarning, "<cache>", 1)
