"""Bone next to an organ, from labels of a segmentation: its voxels near the organ.

`gluteus/femur+hip`, or `liver+tumour/rib`, names the labels of bone after those of the organ.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion

from palpate.physics.errors import MeshError
from palpate.physics.nearest import nearest, tree_of
from palpate.physics.segmentation.image import LabelImage, Segment
from palpate.physics.segmentation.region import Region

REACH = 64e-3
"""[m] Around the organ's box; bone farther away has no effect on a patch of 8 mm (`physics.materials.bone`)."""
NEXT = 20e-3  # [m] distance up to which a label is reported as next to the organ


class Bone(NamedTuple):
    """Labels of bone: their names, their smallest distance from the voxels of the organ [m], and the file of their
    voxels."""

    name: str
    distance: float
    shape: str = ""


def bone_of(image: LabelImage, segments: Sequence[Segment], organ: Segment) -> tuple[Bone, Region]:
    """The voxels of labels of bone. MeshError: one is the organ, or all are too far from it."""
    for segment in segments:
        if segment == organ:
            raise MeshError(f"{image.file}: found {segment} as organ and as its bone, expected different labels")
    near = _around(image.mask(organ), image.spacing, REACH)
    body = _voxels(image, organ, near)
    voxels = np.any([_voxels(image, segment, near) for segment in segments], axis=0) & ~body
    name = ", ".join(map(str, segments))
    if not voxels.any():
        raise MeshError(
            f"{image.file}: {name} is farther than {1e3 * REACH:.3g} mm from {organ}, where bone has no effect on the "
            "touch; leave it out"
        )
    box = _around(voxels, image.spacing, 0.0)
    begin = np.array([whole.start + part.start for whole, part in zip(near, box, strict=True)])
    affine = np.column_stack([image.affine[:, :3], image.affine[:, :3] @ begin + image.affine[:, 3]])
    return Bone(name, _apart(voxels, body, image.spacing)), Region(voxels[box], affine)


def neighbours(image: LabelImage, organ: Segment) -> tuple[tuple[str, float], ...]:
    """The names of the labels next to an organ, with their distances from it [m], the nearest first."""
    near = _around(image.mask(organ), image.spacing, NEXT)
    body, found = _voxels(image, organ, near), []
    there = [np.bincount(layer[near].ravel(), minlength=1) for layer in image.layers]
    for segment in image.segments:
        if segment == organ or segment.value >= len(there[segment.layer]) or not there[segment.layer][segment.value]:
            continue
        voxels = _voxels(image, segment, near) & ~body
        if voxels.any() and (away := _apart(voxels, body, image.spacing)) <= NEXT:
            found.append((str(segment), away))
    return tuple(sorted(found, key=lambda each: each[1]))


def _voxels(image: LabelImage, segment: Segment, near: tuple[slice, ...]) -> np.ndarray:
    return np.asarray(image.layers[segment.layer][near] == segment.value)


def _around(mask: np.ndarray, spacing: np.ndarray, margin: float) -> tuple[slice, ...]:
    """The box of the true voxels with a margin [m], within the image."""
    found = []
    for axis, side in enumerate(spacing):
        there = np.flatnonzero(mask.any(axis=tuple(k for k in range(3) if k != axis)))
        more = int(np.ceil(margin / side))
        found.append(slice(max(int(there[0]) - more, 0), int(there[-1]) + 1 + more))
    return tuple(found)


def _apart(voxels: np.ndarray, body: np.ndarray, spacing: np.ndarray) -> float:
    """Smallest distance [m] between the middles of voxels and those of the organ, less a side of a voxel: 0 where they
    touch."""
    places = [np.argwhere(each & ~binary_erosion(each)) * spacing for each in (body, voxels)]
    least = float(nearest(tree_of(places[0]), places[1])[0].min())
    return max(least - float(spacing.min()), 0.0)
