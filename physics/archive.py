"""Files written whole or not at all, and arrays read though somebody else may have written or damaged them."""

import math
import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from palpate.physics.errors import PalpateError

MOST = 1 << 30  # [bytes] Largest archive, unpacked: some twenty times the largest basis that is built
BLOCK = 1 << 20
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
# What zipfile, zlib and numpy raise on bytes that are not what they should be; the header of an array is parsed as text
# of Python, and a damaged directory may ask for encryption or for a compression that is not there.
_BAD = (OSError, KeyError, ValueError, TypeError, EOFError, MemoryError, OverflowError, RuntimeError, SyntaxError,
        zlib.error, zipfile.BadZipFile)  # fmt: skip


class ArchiveError(PalpateError, ValueError):
    """A file that is no archive of arrays, or a damaged one; says which file and what was found."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A file to write, which takes the place of `path` when it is whole; broken off, it is gone, `path` as it was."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def read_arrays(path: str | Path, *names: str) -> dict[str, np.ndarray]:
    """The arrays of an .npz file by name; only these, if any is named, where the file has them.

    Sizes are compared before anything is unpacked: those of all members with `MOST`, that of a member with the shape in
    its header. Each array is then filled block by block, without a copy. Objects, which would run code, are refused.

    ArchiveError: no such file, no .npz file, damaged, or more than `MOST` bytes.
    """
    try:
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
    with archive.open(member) as file:
        stream: Any = file
        version = npy.read_magic(stream)
        if version not in _HEADERS:
            raise ValueError(f"{member.filename}: format {version}, expected one of {sorted(_HEADERS)}")
        shape, fortran, dtype = _HEADERS[version](stream)
        if dtype.hasobject:
            raise ValueError(f"{member.filename}: holds objects, expected numbers or text")
        wanted, there = math.prod(shape) * dtype.itemsize, member.file_size - file.tell()
        if wanted != there:
            raise ValueError(f"{member.filename}: {there} bytes of data, shape {shape} of {dtype} takes {wanted}")
        array = np.empty(math.prod(shape), dtype)
        data = array.view(np.uint8).data if wanted else memoryview(b"")
        for at in range(0, wanted, BLOCK):
            block = file.read(min(BLOCK, wanted - at))
            data[at : at + len(block)] = block  # ValueError: fewer are there than the directory says
        file.read(1)  # at its end the member is compared with its checksum
    return array.reshape(shape, order="F" if fortran else "C")
