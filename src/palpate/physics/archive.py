"""Atomic writing of files, and safe reading of arrays from untrusted or damaged ones."""

from __future__ import annotations

import math
import os
import shutil
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.physics.errors import PalpateError
from palpate.physics.readable import check_readable

if TYPE_CHECKING:
    import numpy as np

MOST = 1 << 30  # [bytes] Largest archive, unpacked: about 20 times the largest basis that is built
BLOCK = 1 << 20
# Raised by zipfile, zlib and numpy on malformed bytes. The header of an array is parsed as Python text, and a damaged
# directory may name encryption or an unknown compression.
_BAD = (OSError, KeyError, ValueError, TypeError, EOFError, MemoryError, OverflowError, RuntimeError, SyntaxError,
        tokenize.TokenError, zlib.error, zipfile.BadZipFile)  # fmt: skip


class ArchiveError(PalpateError, ValueError):
    """A file is not an archive of arrays, or is damaged; names the file and what was found."""


@contextmanager
def replacing(path: Path, cached: bool = False) -> Iterator[Path]:
    """A temporary file to write, which replaces `path` on success. On failure, as with a full disk, it is removed and
    `path` is unchanged. A pipe or a terminal is written directly; behind a link, the file that it names is replaced.

    cached  a file of a cache: others may not write to it for any umask, as `trust` expects
    """
    if not cached:
        path = Path(os.path.realpath(path))
        if path.exists() and not path.is_file() and not path.is_dir():
            yield path
            return
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part{path.suffix}")
    part.unlink(missing_ok=True)
    try:
        # A new file, never a link that another user has put there in a shared folder.
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644 if cached else 0o666))
        yield part
        if path.is_file() and not cached:
            shutil.copymode(path, part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def replace_text(path: Path, text: str) -> None:
    """Write a text (UTF-8) to a file, complete or not at all. OSError: it cannot be written; the file is unchanged."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


def read_arrays(path: str | Path, *names: str) -> dict[str, np.ndarray]:
    """The arrays of an .npz file by name; if `names` are given, only those of them that the file contains.

    Sizes are checked before anything is unpacked: the total against `MOST`, that of each member against the shape in
    its header. Each array is then filled block by block, without a copy. Pickled objects could run code: refused.

    ArchiveError: a missing or damaged file, not .npz, or more than `MOST` bytes.
    """
    try:
        check_readable(path)
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            size = sum(member.file_size for member in members)
            if size > MOST:
                raise ValueError(f"{size} bytes unpacked, expected at most {MOST}")
            named = {member.filename.removesuffix(".npy"): member for member in members}
            return {name: _array(archive, named[name]) for name in named if not names or name in names}
    except _BAD as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise ArchiveError(f"{path}: cannot be read as .npz: {reason}") from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    import numpy as np  # commands that only replace files start without it
    from numpy.lib import format as npy

    headers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    with archive.open(member) as file:
        stream: Any = file
        version = npy.read_magic(stream)
        if version not in headers:
            raise ValueError(f"{member.filename}: format {version}, expected one of {sorted(headers)}")
        shape, fortran, dtype = headers[version](stream)
        if dtype.hasobject:
            raise ValueError(f"{member.filename}: contains objects, expected numbers or text")
        wanted, found = math.prod(shape) * dtype.itemsize, member.file_size - file.tell()
        if wanted != found:
            raise ValueError(f"{member.filename}: {found} bytes, expected {wanted} for shape {shape} of {dtype}")
        array = np.empty(math.prod(shape), dtype)
        data = array.view(np.uint8).data if wanted else memoryview(b"")
        for at in range(0, wanted, BLOCK):
            block = file.read(min(BLOCK, wanted - at))
            data[at : at + len(block)] = block  # ValueError: fewer bytes than the directory declares
        file.read(1)  # zipfile compares the checksum at the end of the member
    return array.reshape(shape, order="F" if fortran else "C")
