"""Reads the voxels of an image as labels, in memory that grows with the number of voxels and the length of the file.

Compressed voxels are decompressed piece by piece, and become 8 or 16 bits before the next piece is read: a mask that a
program has written as 64-bit numbers needs an eighth of the memory that a library would take.
"""

import bz2
import gzip
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np

from palpate.physics.claims import check_claim
from palpate.physics.segmentation.image import Segment, count_values

MOST_VOXELS = 1 << 28  # [1] 512 MB as 16 bits: 512 x 512 x 1024
MOST_FILE = 1 << 30  # [bytes]
MOST_HEAD = 1 << 24  # [bytes] before the voxels
RATIO = 1100  # [1] Voxels over the length of a file: deflate reaches 1032, and a mask with much air comes near it
LARGEST = (1 << 16) - 1  # [1] label
PIECE = 1 << 22  # [bytes] read at once
GREY_FROM, GREY = 16, 0.5
"""[1] An image with at least this number of values, in which neighbouring voxels differ in this share of the pairs, is
no segmentation: in one, most neighbours of a voxel have its label."""
KINDS = "uif"  # kinds of numbers, as numpy names them


@dataclass(frozen=True)
class Layout:
    """Where the voxels of a file are, and where in the body.

    shape     (i,j,k), the first index varies fastest; or (layers,i,j,k)
    affine    [mm] (3,4) from indices to x to the right, y to the front, z to the head
    packing   raw, gzip, zlib or bzip2 from the byte `begin`; `skip`: bytes of the unpacked contents before the voxels
    scale     factor and summand of each value
    """

    shape: tuple[int, ...]
    kind: np.dtype[Any]
    affine: np.ndarray
    packing: str = "raw"
    begin: int = 0
    skip: int = 0
    scale: tuple[float, float] = (1.0, 0.0)
    listed: tuple[Segment, ...] = ()
    names: dict[int, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


class _Readable(Protocol):
    def read(self, size: int, /) -> bytes: ...


class _Inflated:
    """The contents of a zlib stream, unpacked as they are read."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._unpacker = file, zlib.decompressobj()

    def read(self, size: int, /) -> bytes:
        packed = self._unpacker.unconsumed_tail or self._file.read(1 << 16)
        found = self._unpacker.decompress(packed, size)
        while packed and not found and not self._unpacker.eof:
            packed = self._file.read(1 << 16)
            found = self._unpacker.decompress(packed, size)
        return found


PACKINGS: Mapping[str, Callable[[IO[bytes]], _Readable]] = {
    "raw": lambda file: file, "gzip": lambda file: gzip.GzipFile(fileobj=file), "zlib": _Inflated,
    "bzip2": lambda file: bz2.BZ2File(file),
}  # fmt: skip


def read_voxels(path: Path, layout: Layout, held: int) -> np.ndarray:
    """Labels (layers,i,j,k), uint8 or uint16, of a file with `held` bytes. ValueError: too many, cut off, no labels."""
    count = math.prod(layout.shape)
    if min(layout.shape) < 1 or count > MOST_VOXELS:
        raise ValueError(f"its header claims {_sides(layout.shape)} voxels, expected at most {MOST_VOXELS}")
    if layout.kind.kind not in KINDS:
        raise ValueError("its voxels are colours or complex numbers, expected labels, one number for each voxel")
    claimed = count * layout.kind.itemsize
    if layout.packing == "raw":
        if claimed > held - layout.begin - layout.skip:
            room = max(held - layout.begin - layout.skip, 0)
            raise ValueError(f"its header announces {claimed} bytes of voxels, it has {room}: it is cut off or damaged")
    else:
        check_claim("its header", claimed, held, RATIO)
    labels = np.empty(count, np.uint8 if layout.kind.itemsize == 1 else np.uint16)
    with path.open("rb") as file:
        file.seek(layout.begin)
        stream = PACKINGS[layout.packing](file)
        try:
            _skip(stream, layout.skip)
            _fill(labels, stream, layout)
        except (EOFError, zlib.error, OSError) as error:
            raise ValueError(f"its compressed voxels cannot be read ({error}): it is cut off or damaged") from None
    found = labels.reshape(layout.shape, order="F")
    found = found[None] if found.ndim == 3 else found
    _check_grey(found)
    return found


def _skip(stream: _Readable, size: int) -> None:
    while size > 0:
        piece = stream.read(min(size, PIECE))
        if not piece:
            raise ValueError("it ends before its voxels: it is cut off")
        size -= len(piece)


def _fill(labels: np.ndarray, stream: _Readable, layout: Layout) -> None:
    """Read all labels, piece by piece."""
    width, at, rest = layout.kind.itemsize, 0, b""
    while at < len(labels):
        piece = stream.read(min(PIECE, width * (len(labels) - at) - len(rest)))
        if not piece:
            raise ValueError(
                f"it ends after {width * at + len(rest)} of {width * len(labels)} bytes of voxels: it is cut off"
            )
        rest += piece
        whole = len(rest) // width
        values = np.frombuffer(rest, layout.kind, whole)
        labels[at : at + whole] = _as_labels(values, layout.scale)
        at, rest = at + whole, rest[width * whole :]


def _as_labels(values: np.ndarray, scale: tuple[float, float]) -> np.ndarray:
    """Whole numbers from 0 to `LARGEST`. ValueError: others."""
    factor, summand = scale
    if (factor, summand) != (1.0, 0.0):
        values = values * factor + summand
    if not len(values) or values.dtype == np.uint8:
        return values
    low, high = values.min(), values.max()
    if not (low >= 0 and high <= LARGEST):  # also NaN
        raise ValueError(f"it has voxels from {low:g} to {high:g}: grey values or a map, no segmentation. {_EXPECTED}")
    if values.dtype.kind == "f" and (bad := values != np.rint(values)).any():
        raise ValueError(f"it has a voxel of {values[bad][0]:g}: a map or grey values, no segmentation. {_EXPECTED}")
    return values


_EXPECTED = (
    "Expected labels, whole numbers from 0. Segment the image first, or set a threshold: numpy's (image > 0.5) of a map"
)


def _check_grey(layers: np.ndarray) -> None:
    """ValueError: an image whose neighbouring voxels differ as often as those of grey values."""
    for layer in layers:
        values = np.count_nonzero(count_values(layer))
        if values < GREY_FROM:
            continue
        middle = layer[:, :, layer.shape[2] // 4 : -(-3 * layer.shape[2] // 4)]
        one, other = middle[1:], middle[:-1]
        pairs, unlike = np.count_nonzero(one | other), np.count_nonzero(one != other)
        if unlike > GREY * pairs:
            raise ValueError(
                f"it has {values} values, and {unlike / pairs:.0%} of its neighbouring voxels differ: grey values, no "
                f"segmentation. {_EXPECTED}"
            )


def _sides(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))
