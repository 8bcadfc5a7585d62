"""The closed surface of a segment, with what was changed on the way."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import find_objects
from scipy.ndimage import label as find_pieces

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.segmentation.boxed import box_of
from palpate.physics.segmentation.image import LabelImage, Segment
from palpate.physics.segmentation.isosurface import enclosed_volume, march_cubes
from palpate.physics.segmentation.smoothed import margin, smooth_level

HOLE = 0.01
"""[1] Volume of a hole over that of the organ below which it is a fault of the segmentation, and filled. Holes of other
labels, such as a tumour or a vessel, are filled, too: they are solid."""
SHOWN = 4  # holes that a note lists


class Segmented(NamedTuple):
    """The surface of a segment, and what it is made of.

    mesh      [m] closed, x to the right, y to the front, z to the head
    volume    [m³] of the voxels, filled holes included
    enclosed  [m³] by the mesh
    notes     what was assumed or changed, one line each
    """

    mesh: Mesh
    volume: float
    enclosed: float
    notes: tuple[str, ...]


def label_surface(image: LabelImage, segment: Segment) -> Segmented:
    """The surface of a segment's voxels: the level of their smoothed distance (`smoothed`) that encloses their volume.

    Small holes and those of other labels are filled. A segment that the border of the image cuts is closed there.

    MeshError: too few voxels, or too many.
    """
    mask, begin, left_out = box_of(image, segment)
    notes = [*image.notes, *left_out] + _border(image, segment, mask, begin)
    filled, more = _fill_holes(image, segment, mask, begin)
    size = float(np.abs(np.linalg.det(image.affine[:, :3])))
    volume = size * np.count_nonzero(filled)
    pad = margin(image.spacing)
    level = smooth_level(np.pad(filled, [(p, p) for p in pad]), image.spacing)
    mesh = march_cubes(image, level, begin - pad, volume)
    return Segmented(mesh, volume, enclosed_volume(mesh), tuple(notes + more))


def _border(image: LabelImage, segment: Segment, mask: np.ndarray, begin: np.ndarray) -> list[str]:
    """A note on the voxels at the border of the image, where a segment is cut off."""
    shape, area, sides = image.layers.shape[1:], 0.0, []
    columns = image.affine[:, :3]
    for axis in range(3):
        face = float(np.linalg.norm(np.cross(*np.delete(columns, axis, axis=1).T)))
        for end, index, at in ((0, 0, begin[axis]), (-1, shape[axis] - 1, begin[axis] + mask.shape[axis] - 1)):
            if index == at and (cut := np.count_nonzero(np.take(mask, end, axis=axis))):
                area += cut * face
                sides.append(_side(columns[:, axis] * (1.0 if end else -1.0)))
    if not area:
        return []
    return [
        f"the label {segment} reaches the border of the image ({', '.join(sides)}), which cuts it over "
        f"{1e4 * area:.3g} cm²: it is closed by a plane there, which is not its surface"
    ]


def _side(outwards: np.ndarray) -> str:
    """The side of the body to which a direction points most."""
    axis = int(np.abs(outwards).argmax())
    return (("left", "right"), ("back", "front"), ("feet", "head"))[axis][int(outwards[axis] > 0.0)]


def _fill_holes(
    image: LabelImage, segment: Segment, mask: np.ndarray, begin: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """The mask without the holes that are filled, and notes on all holes."""
    outside, count = find_pieces(np.pad(~mask, 1, constant_values=True))
    if count == 1:
        return mask, []
    pieces = outside[1:-1, 1:-1, 1:-1]
    sizes = np.bincount(pieces.reshape(-1))
    holes = [k for k in range(1, count + 1) if k != outside[0, 0, 0]]
    holes.sort(key=lambda k: -sizes[k])
    boxes, voxel = find_objects(pieces), float(np.abs(np.linalg.det(image.affine[:, :3])))
    filled, texts, kept = mask.copy(), [], []
    layer = image.layers[segment.layer]
    names = {each.value: str(each) for each in image.segments if each.layer == segment.layer}
    for number, k in enumerate(holes):
        box = boxes[k - 1]
        inside = pieces[box] == k
        at = tuple(slice(side.start + int(b), side.stop + int(b)) for side, b in zip(box, begin, strict=True))
        values = np.bincount(layer[at][inside])
        most = int(values.argmax())
        text = f"{1e6 * voxel * sizes[k]:.3g} cm³"
        if most == 0 and sizes[k] >= HOLE * np.count_nonzero(mask):
            kept.append(text)
            continue
        filled[box] |= inside
        if number < SHOWN:
            texts.append(text + (f" of label {names[most]}" if most else ""))
    texts += [f"{len(holes) - len(kept) - len(texts)} more"] * (len(holes) - len(kept) > len(texts))
    many = len(holes) - len(kept)
    notes = [f"{many} hole{'s' * (many > 1)} in the label {segment} filled: {', '.join(texts)}"] if many else []
    if kept:
        notes.append(
            f"the label {segment} has {len(kept)} cavit{'ies' if len(kept) > 1 else 'y'} of {', '.join(kept[:SHOWN])}"
            f", which remain{'s' * (len(kept) == 1)}: more than {HOLE:.0%} of its volume"
        )
    return filled, notes
