"""Files of compiled kernels: each contains one kernel for one set of types, with its length and hash.

The content is a pickle, which can run any code when it is loaded. Therefore a file is read only if it is trusted
(`trust`). The checks apply to open descriptors, so that nothing can be exchanged between check and use. Length and
hash, which covers the name, are checked before loading: they detect files that are damaged or were renamed.
"""

import contextlib
import hashlib
import os
import secrets
import stat
import struct
import time
from collections.abc import Iterator
from pathlib import Path

from palpate.compiler.trust import NO_LINK, UntrustedError, check_trust, open_in, open_trusted

try:
    import fcntl
except ImportError:  # not POSIX: two processes that need the same kernel at the same time both compile it
    fcntl = None  # type: ignore[assignment]

MAGIC = b"palpate kernel 1"
HEADER = struct.Struct(f"<{len(MAGIC)}sQ32s")  # magic, length of the content [bytes], SHA-256 of name and content
USED = 86400.0  # [s] Age from which the time of a file that is read is set again
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | NO_LINK


def read(folder: Path, name: str, source: os.stat_result | None = None) -> bytes | None:
    """The content of a file; None: missing or damaged. UntrustedError: another user can have written it.

    source  see `check_trust`
    """
    try:
        with open_trusted(folder, source) as at, open(open_in(folder, name, at), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                return None
            check_trust(found, source=source)
            data = file.read()
            if source is None and time.time() - found.st_mtime > USED:
                _mark_used(file.fileno())
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


def _mark_used(descriptor: int) -> None:
    """Set the time of a file, by which `kernel_cache.limit_size` knows those that are used."""
    if os.utime in os.supports_fd:
        with contextlib.suppress(OSError):
            os.utime(descriptor)


def write(folder: Path, name: str, content: bytes) -> None:
    """Write a file so that a crash or a power failure leaves either the previous file or the whole new one. OSError:
    not possible."""
    with open_trusted(folder) as at:
        temporary = f"{name}.{secrets.token_hex(8)}"
        try:
            with open(open_in(folder, temporary, at, _NEW), "wb") as file:
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
def hold_lock(folder: Path, name: str) -> Iterator[None]:
    """Wait until no other process holds this lock; no effect where it cannot be created."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            with open_trusted(folder) as at:
                flags = os.O_RDWR | os.O_CREAT | NO_LINK
                file = stack.enter_context(open(open_in(folder, name, at, flags), "r+b"))
            if fcntl is not None:
                fcntl.lockf(file, fcntl.LOCK_EX)
        yield


def _digest(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + content).digest()
