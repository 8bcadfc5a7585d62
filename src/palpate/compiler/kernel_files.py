"""Files of compiled kernels: each contains one kernel for one set of types, with its length and hash.

The content is a pickle, which can run any code when it is loaded. Therefore a file is read only if this user or root
has written it: folder and file belong to one of the two, are not writable by others, and are no symbolic links. The
checks apply to open descriptors, so that nothing can be exchanged between check and use. Length and hash, which covers
the name, are checked before loading: they detect files that are damaged or were renamed.
"""

import contextlib
import hashlib
import os
import secrets
import stat
import struct
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # not POSIX: two processes that need the same kernel at the same time both compile it
    fcntl = None  # type: ignore[assignment]

MAGIC = b"palpate kernel 1"
HEADER = struct.Struct(f"<{len(MAGIC)}sQ32s")  # magic, length of the content [bytes], SHA-256 of name and content
OTHERS = stat.S_IWGRP | stat.S_IWOTH  # write access for others; a POSIX access list shows in the bits of the group

_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | _NO_LINK
_FILE = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | _NO_LINK
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | _NO_LINK
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
def _opened(folder: Path, source: os.stat_result | None = None) -> Iterator[int | None]:
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
    with _opened(folder):
        pass


def read(folder: Path, name: str, source: os.stat_result | None = None) -> bytes | None:
    """The content of a file; None: missing or damaged. UntrustedError: another user can have written it.

    source  see `check_trust`
    """
    try:
        with _opened(folder, source) as at, open(_open(folder, name, _FILE, at), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                return None
            check_trust(found, source=source)
            data = file.read()
    except UntrustedError:
        raise
    except OSError:
        return None
    if len(data) < HEADER.size:
        return None
    magic, length, digest = HEADER.unpack_from(data)
    content = data[HEADER.size :]
    if magic != MAGIC or length != len(content) or digest != _digest(name, content):
        return None
    return content


def write(folder: Path, name: str, content: bytes) -> None:
    """Write a file so that a crash or a power failure leaves either the previous file or the whole new one. OSError:
    not possible."""
    with _opened(folder) as at:
        temporary = f"{name}.{secrets.token_hex(8)}"
        try:
            with open(_open(folder, temporary, _NEW, at), "wb") as file:
                file.write(HEADER.pack(MAGIC, len(content), _digest(name, content)))
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            if at is None:
                os.replace(folder / temporary, folder / name)
            else:
                os.replace(temporary, name, src_dir_fd=at, dst_dir_fd=at)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(folder / temporary if at is None else temporary, dir_fd=at)
            raise


@contextlib.contextmanager
def locked(folder: Path, name: str) -> Iterator[None]:
    """Wait until no other process holds this lock; no effect where it cannot be created."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            with _opened(folder) as at:
                flags = os.O_RDWR | os.O_CREAT | _NO_LINK
                file = stack.enter_context(open(_open(folder, name, flags, at), "r+b"))
            if fcntl is not None:
                fcntl.lockf(file, fcntl.LOCK_EX)
        yield


def _open(folder: Path, name: str, flags: int, at: int | None) -> int:
    return os.open(folder / name, flags, 0o644) if at is None else os.open(name, flags, 0o644, dir_fd=at)


def _digest(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + content).digest()
