"""The voxels of a segment in their box, which becomes smaller if single voxels lie far from the organ."""

import numpy as np
from scipy.ndimage import find_objects
from scipy.ndimage import label as find_pieces

from palpate.physics.errors import MeshError
from palpate.physics.segmentation.image import LabelImage, Segment

MOST_SAMPLES = 1 << 25
"""[1] of the box of a segment: 320 in each direction, 250 mm at 0.8 mm. They take 0.6 GB."""
LEAST_VOXELS = 27  # of a segment
SPECK = 0.01  # [1] voxels of a separate part over those of the largest, below which it is left out of a large box
COARSE = 4  # voxels along a side of the cells in which separate parts are found


def box_of(image: LabelImage, segment: Segment) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The voxels (i,j,k) of a segment in their box, its first voxel (3), and a note on parts that are left out.

    MeshError: too few voxels, or too many.
    """
    count = image.count(segment)
    if count < LEAST_VOXELS:
        raise MeshError(
            f"{image.file}: the label {segment} has {count} voxels, expected at least {LEAST_VOXELS} of an organ"
        )
    box = find_objects(image.layers[segment.layer])[segment.value - 1]
    mask = image.layers[segment.layer][box] == segment.value
    begin, notes = np.array([side.start for side in box]), list[str]()
    if _samples(image, mask) > MOST_SAMPLES:
        mask, first, parts = _without_specks(mask)
        begin = begin + first
        if parts:
            share = 1.0 - np.count_nonzero(mask) / count
            notes.append(
                f"{parts} part{'s' * (parts > 1)} of the label {segment} with less than {SPECK:.0%} of the largest, "
                f"together {share:.2g} of its voxels, {'are' if parts > 1 else 'is'} left out"
            )
    if (samples := _samples(image, mask)) > MOST_SAMPLES:
        raise MeshError(
            f"{image.file}: the label {segment} spans {' x '.join(map(str, mask.shape))} voxels, which are "
            f"{samples:.3g} samples, expected at most {MOST_SAMPLES:.3g}. Resample it to voxels that are "
            f"{np.cbrt(samples / MOST_SAMPLES):.2g} times as long"
        )
    return mask, begin, notes


def _samples(image: LabelImage, mask: np.ndarray) -> float:
    return float(np.prod(mask.shape * np.maximum(1, np.round(image.spacing / image.spacing.min()))))


def _without_specks(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The large parts of a mask in their box, its first voxel (3), and the number of parts that are left out. Parts
    within a cell of each other count as one."""
    cells = mask.view(np.uint8)
    for axis, size in enumerate(mask.shape):
        cells = np.add.reduceat(cells, np.arange(0, size, COARSE), axis=axis, dtype=np.uint8)
    parts, _ = find_pieces(cells > 0, np.ones((3, 3, 3)))
    sizes = np.bincount(parts.ravel(), cells.ravel())
    sizes[0] = 0
    large = sizes >= SPECK * sizes.max()
    kept = large[parts]
    (box,) = find_objects(kept.astype(np.uint8))
    fine = tuple(slice(COARSE * side.start, COARSE * side.stop) for side in box)
    chosen = kept[box]
    for axis in range(3):
        chosen = np.repeat(chosen, COARSE, axis=axis)
    found = mask[fine]
    found = found & chosen[tuple(slice(n) for n in found.shape)]
    return found, np.array([side.start for side in fine]), int((~large[1:]).sum())
