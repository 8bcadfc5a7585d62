"""A label inside of an organ, such as a tumour, as the nodule of a body.

`liver+tumour` names the organ and the label inside of it. The organ then contains both. A compact label is a sphere
with the volume and the centre of its largest connected part; any other one, such as a vessel, keeps its voxels.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation, find_objects
from scipy.ndimage import label as find_pieces

from palpate.physics.errors import MeshError
from palpate.physics.segmentation.endings import JOIN, ON
from palpate.physics.segmentation.image import LabelImage, Segment, choose_label
from palpate.physics.segmentation.region import Region

LONG = 1.5  # [1] ratio of the longest to the shortest axis above which a part keeps its voxels
LEAST = 8  # voxels
SHARE = 0.9  # [1] of the voxels in the largest part, below which all parts keep their voxels


class Inclusion(NamedTuple):
    """A label in an organ.

    name    of the label
    centre  [m] (3) of its largest part, x to the right, y to the front, z to the head
    radius  [m] of the sphere of the same volume
    notes   why it is no sphere
    shape   file of its voxels (`region`); "": it is a sphere
    """

    name: str
    centre: tuple[float, float, float]
    radius: float
    notes: tuple[str, ...] = ()
    shape: str = ""


class Chosen(NamedTuple):
    """The segments that a label names: an organ, a part inside of it, and bone next to it; and the image, in which the
    voxels of the part are also voxels of the organ."""

    image: LabelImage
    organ: Segment
    inside: Segment | None = None
    bone: tuple[Segment, ...] = ()


def choose_organ(image: LabelImage, label: int | str | None) -> Chosen:
    """The segments that a label names, `organ`, `organ+inside`, `organ/bone+bone` or `organ+inside/bone`, unless the
    file has a label of this name. MeshError: a label is missing or not unique, or there is more than one part inside.
    """
    text = str(label).strip()
    if not {JOIN, ON} & set(text) or any(text.casefold() == each.name.casefold() for each in image.segments):
        return Chosen(image, choose_label(image, label))
    body, on, below = text.partition(ON)
    names, bones = ([name.strip() for name in part.split(JOIN)] for part in (body, below))
    if len(names) > 2 or not all(names) or (on and not all(bones)) or ON in below:
        raise MeshError(
            f"{image.file}: found the label {text!r}, expected an organ and one label inside of it, as "
            "liver+tumour, or bone next to it, as liver/rib_left_9+rib_left_10; a body has one nodule"
        )
    organ, *parts = (choose_label(image, name) for name in names)
    bone = tuple(choose_label(image, name) for name in bones) if on else ()
    if not parts:
        return Chosen(image, organ, None, bone)
    inside = parts[0]
    if organ == inside:
        raise MeshError(f"{image.file}: found the label {text!r}, which names {organ} twice")
    layers = image.layers.copy()
    layers[organ.layer][image.mask(inside)] = organ.value
    listed = image.listed or tuple(image.segments)
    joined = LabelImage(image.file, layers, image.affine, listed, image.names, image.notes)
    return Chosen(joined, organ, inside, bone)


def inclusion_of(image: LabelImage, segment: Segment, organ: Segment) -> tuple[Inclusion, Region | None]:
    """The label of a segment of an image, and its voxels if it is no sphere. MeshError: it has too few voxels, or does
    not touch the organ."""
    box = find_objects(image.layers[segment.layer])[segment.value - 1]
    pieces, count = find_pieces(image.layers[segment.layer][box] == segment.value, np.ones((3, 3, 3)))
    sizes = np.bincount(pieces.ravel())[1:]
    most = int(sizes.argmax())
    if sizes[most] < LEAST:
        raise MeshError(
            f"{image.file}: the label {segment} has {sizes[most]} connected voxels, expected at least {LEAST} of a "
            "nodule"
        )
    index = np.argwhere(pieces == most + 1) + [side.start for side in box]
    low, high = np.maximum(index.min(axis=0) - 1, 0), index.max(axis=0) + 2
    near = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    part = np.zeros(image.layers.shape[1:], bool)[near]
    part[tuple((index - low).T)] = True
    if not (image.layers[organ.layer][near] == organ.value)[binary_dilation(part)].any():
        raise MeshError(f"{image.file}: the label {segment} does not touch {organ}, expected a label inside of it")
    points = index @ image.affine[:, :3].T + image.affine[:, 3]
    centre = points.mean(axis=0)
    volume = len(points) * float(abs(np.linalg.det(image.affine[:, :3])))
    radius = (0.75 * volume / np.pi) ** (1.0 / 3.0)
    # A solid ellipsoid has the variance a^2/5 along an axis a; a voxel of side h adds h^2/12.
    spread = np.cov(points.T, bias=True) + image.affine[:, :3] @ image.affine[:, :3].T / 12.0
    axes = np.sqrt(5.0 * np.linalg.eigvalsh(spread))
    notes = []
    if count > 1 and sizes[most] < SHARE * sizes.sum():
        notes.append(f"{count} separate parts, the largest {sizes[most] / sizes.sum():.0%}: each keeps its voxels")
    if axes[2] > LONG * axes[0]:
        sides = " x ".join(f"{2e3 * side:.3g}" for side in axes[::-1])
        notes.append(f"about {sides} mm, no sphere: it keeps its voxels")
    x, y, z = centre.tolist()
    region = None
    if notes:
        first = np.array([side.start for side in box])
        affine = np.column_stack([image.affine[:, :3], image.affine[:, :3] @ first + image.affine[:, 3]])
        region = Region(image.layers[segment.layer][box] == segment.value, affine)
    return Inclusion(str(segment), (x, y, z), radius, tuple(notes)), region
