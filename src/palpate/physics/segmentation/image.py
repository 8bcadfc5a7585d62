"""An image of labels, its segments, and the choice of one of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.ndimage import find_objects

from palpate.physics.errors import MeshError

SHOWN = 12  # labels that a message lists
PIECE = 1 << 20  # voxels that are counted at once


class Segment(NamedTuple):
    """The voxels of a layer with a value.

    number  by which it is chosen: the value, unless several layers have the same values     name  "": the file has none
    """

    number: int
    name: str
    layer: int
    value: int

    def __str__(self) -> str:
        return f"{self.number} ({self.name})" if self.name else str(self.number)


@dataclass(frozen=True)
class LabelImage:
    """Voxels of whole numbers, 0 for none, at their place in the body.

    layers   [1] (layers,i,j,k) uint8 or uint16; several where segments may overlap
    affine   [m] (3,4) from indices (i,j,k,1) of voxel centres to x to the right, y to the front, z to the head (RAS)
    listed   the segments that the file lists; empty: each value that occurs is one
    names    of values, as the file has them
    notes    assumptions about the file
    """

    file: str
    layers: np.ndarray
    affine: np.ndarray
    listed: tuple[Segment, ...] = ()
    names: dict[int, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def spacing(self) -> np.ndarray:
        """Sides of a voxel [m] (3)."""
        return np.asarray(np.linalg.norm(self.affine[:, :3], axis=0))

    @cached_property
    def counts(self) -> list[np.ndarray]:
        """Number of voxels of each value, for each layer."""
        return [count_values(layer) for layer in self.layers]

    @cached_property
    def segments(self) -> list[Segment]:
        """The segments with at least one voxel, by their number."""
        if not self.listed:
            return [Segment(int(v), self.names.get(int(v), ""), 0, int(v)) for v in np.flatnonzero(self.counts[0]) if v]
        return sorted(each for each in self.listed if self.count(each))

    def count(self, segment: Segment) -> int:
        """Number of its voxels."""
        counts = self.counts[segment.layer]
        return int(counts[segment.value]) if segment.value < len(counts) else 0

    def mask(self, segment: Segment) -> np.ndarray:
        """Its voxels (i,j,k), True inside."""
        return np.asarray(self.layers[segment.layer] == segment.value)

    def volume(self, segment: Segment) -> float:
        """Of its voxels [m³]."""
        return self.count(segment) * float(abs(np.linalg.det(self.affine[:, :3])))


def count_values(layer: np.ndarray) -> np.ndarray:
    """Number of voxels of each value, in pieces: `bincount` takes 8 bytes for each element that it is given."""
    flat = layer.ravel(order="K")
    found = np.zeros(np.iinfo(layer.dtype).max + 1, np.int64)
    for at in range(0, len(flat), PIECE):
        found += np.bincount(flat[at : at + PIECE], minlength=len(found))
    return found


def choose_label(image: LabelImage, label: int | str | None) -> Segment:
    """The segment with a number or a name; None: the only one. MeshError: missing, or not unique."""
    found = image.segments
    if not found:
        raise MeshError(f"{image.file}: all voxels are 0, expected the labels of a segmentation")
    if label is None:
        if len(found) == 1:
            return found[0]
        raise MeshError(
            f"{image.file} has {len(found)} labels: {_list(found)}. Choose one with --label, or label: in organ:"
        )
    text = str(label).strip()
    chosen = [each for each in found if text == str(each.number)]
    chosen = chosen or [each for each in found if text.casefold() == each.name.casefold()]
    if len(chosen) == 1:
        return chosen[0]
    if chosen:
        numbers = " and ".join(str(each.number) for each in chosen)
        raise MeshError(f"{image.file}: the labels {numbers} are called {text!r}; choose one by its number")
    raise MeshError(f"{image.file} has no label {text!r}; it has {_list(found, text)}")


def _list(segments: Sequence[Segment], like: str = "") -> str:
    """The segments in a message, those whose name contains a text first."""
    first = sorted(segments, key=lambda each: not like or like.casefold() not in each.name.casefold())
    more = len(first) - SHOWN
    return ", ".join(map(str, first[:SHOWN])) + (f" and {more} more (palpate list labels)" if more > 0 else "")


def extents(image: LabelImage) -> Iterator[tuple[Segment, np.ndarray, np.ndarray]]:
    """Each segment with the box of its voxels: sides [m] (3) along the axes of the image, and centre [m] (3)."""
    boxes = [find_objects(layer) for layer in image.layers]
    for segment in image.segments:
        box = boxes[segment.layer][segment.value - 1]
        begin, end = np.array([side.start for side in box]), np.array([side.stop for side in box])
        yield (
            segment,
            (end - begin) * image.spacing,
            image.affine[:, :3] @ (0.5 * (begin + end - 1)) + image.affine[:, 3],
        )
