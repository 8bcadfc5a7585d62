"""Reading arrays from an .npz file that somebody else may have written, or damaged."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from palpate.physics.errors import PalpateError

MOST = 1 << 32
"""[bytes] Largest archive, unpacked."""
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
# What zipfile, zlib and numpy raise on bytes that are not what they should be; the header of an array is parsed as text
# of Python, and a damaged directory may ask for encryption or for a compression that is not there.
_BAD = (OSError, KeyError, ValueError, TypeError, EOFError, MemoryError, OverflowError, RuntimeError, SyntaxError,
        zlib.error, zipfile.BadZipFile)  # fmt: skip


class ArchiveError(PalpateError, ValueError):
    """A file that is no archive of arrays, or a damaged one; says which file and what was found."""


def read_arrays(path: str | Path, *names: str) -> dict[str, np.ndarray]:
    """The arrays of an .npz file by name; only these, if any is named, where the file has them.

    No array is made by a length that the file only claims: the bytes in its member are counted before. Objects, which
    would run code, are refused.

    ArchiveError: no such file, no .npz file, damaged, or more than `MOST` bytes.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > MOST:
                raise ValueError(f"more than {MOST} bytes, unpacked")
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
        data = file.read()  # as many bytes as are there; they are verified against their checksum at their end
    array = np.frombuffer(bytearray(data), dtype=dtype)
    return array.reshape(shape, order="F" if fortran else "C")
