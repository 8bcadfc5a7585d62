"""A DICOM segmentation (.dcm), read by pydicom: frames of segments, each at its place; DICOM PS3.3 A.51, C.8.20.

Frames without a voxel are often left out, so the volume is made of the frames that exist. A fractional segment consists
of the voxels of at least half the maximum. Segments that overlap are in separate layers.
"""

import io
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.claims import check_claim
from palpate.physics.readable import check_file
from palpate.physics.segmentation.image import Segment
from palpate.physics.segmentation.metaimage import FROM_ITK
from palpate.physics.segmentation.voxels import LARGEST, MOST_FILE, MOST_VOXELS, RATIO, Layout

SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")  # SOP classes; the second: label map
DEFLATED = b"1.2.840.10008.1.2.1.99"  # transfer syntax whose size is unknown before decompression
UNEVEN = 0.1  # [1] of the distance of two slices, by which a frame may be off


def read_dicom(path: Path) -> tuple[Layout, np.ndarray]:
    """The layout, and the layers (layers,i,j,k). ValueError: what is wrong. Errors of pydicom: a damaged file."""
    import pydicom

    held = check_file(path, MOST_FILE)
    content = path.read_bytes()  # pydicom reserves what a damaged length in a file claims, but not in memory
    if DEFLATED in content:
        raise ValueError("it is deflated. Convert it to another transfer syntax")
    data = pydicom.dcmread(io.BytesIO(content))
    if str(data.get("SOPClassUID")) not in SEGMENTATIONS:
        raise ValueError("it is no DICOM segmentation, but an image. Segment it first")
    size = int(data.NumberOfFrames), int(data.Rows), int(data.Columns)
    if not 0 < size[0] * size[1] * size[2] <= MOST_VOXELS:
        raise ValueError(f"its header claims {size[0]} frames of {size[1]} x {size[2]}, expected {MOST_VOXELS} voxels")
    check_claim("its header", size[0] * size[1] * size[2], held, RATIO)
    frames = np.asarray(data.pixel_array).reshape(size)
    if str(data.get("SegmentationType")) == "FRACTIONAL":
        frames = frames >= 0.5 * float(data.MaximumFractionalValue)
    affine, place = _geometry(data)
    names = {int(s.SegmentNumber): str(s.get("SegmentLabel", "")) for s in data.SegmentSequence}
    if not names or max(names) > LARGEST:
        raise ValueError(f"its segments are numbered up to {max(names, default=0)}, expected 1 to {LARGEST}")
    shape = (size[2], size[1], int(place.max()) + 1)
    if shape[0] * shape[1] * shape[2] > MOST_VOXELS:
        raise ValueError(f"its frames lie {shape[2]} slices apart, expected at most {MOST_VOXELS} voxels")
    if str(data.get("SegmentationType")) == "LABELMAP":
        layer = np.zeros(shape, np.uint16)
        for frame, k in zip(frames, place, strict=True):
            layer[:, :, k] = frame.T
        return Layout(shape, layer.dtype, affine, names=names), layer[None]
    layers, listed = _layers(data, frames, place, shape, names)
    return Layout(shape, layers.dtype, affine, listed=tuple(listed)), layers


def _of_frame(data: Any, number: int, group: str, name: str) -> Any:
    """An attribute of a frame, or else of all."""
    for groups in (data.PerFrameFunctionalGroupsSequence[number], data.SharedFunctionalGroupsSequence[0]):
        if group in groups and name in groups[group].value[0]:
            return groups[group].value[0][name].value
    raise ValueError(f"its frame {number + 1} has no {name}")


def _geometry(data: Any) -> tuple[np.ndarray, np.ndarray]:
    """From indices of column, row, slice [mm] (3,4), and the slice of each frame."""
    count = int(data.NumberOfFrames)
    planes = np.array([
        _of_frame(data, k, "PlaneOrientationSequence", "ImageOrientationPatient") for k in range(count)
    ], float)  # fmt: skip
    turn = planes[0].reshape(2, 3)
    if not np.allclose(planes, planes[0], atol=1e-4):
        raise ValueError("its frames are not parallel. Resample it")
    down, right = (float(v) for v in _of_frame(data, 0, "PixelMeasuresSequence", "PixelSpacing"))
    origins = np.array([
        _of_frame(data, k, "PlanePositionSequence", "ImagePositionPatient") for k in range(count)
    ], float)  # fmt: skip
    normal = np.cross(*turn)
    along = origins @ normal
    apart = np.diff(np.unique(np.round(along, 3)))
    step = float(apart.min()) if len(apart) else float(
        _of_frame(data, 0, "PixelMeasuresSequence", "SliceThickness")
    )  # fmt: skip
    exact = (along - along.min()) / step
    if not (step > 0.0 and np.isfinite(exact).all() and np.abs(exact - np.round(exact)).max() <= UNEVEN):
        raise ValueError("the distances of its frames are no multiples of one. Resample it")
    affine = np.column_stack([right * turn[0], down * turn[1], step * normal, origins[along.argmin()]])
    return FROM_ITK[:, None] * affine, np.round(exact).astype(int)


def _layers(
    data: Any, frames: np.ndarray, place: np.ndarray, shape: tuple[int, int, int], names: dict[int, str]
) -> tuple[np.ndarray, list[Segment]]:
    """Each segment in the first layer in which it overlaps no other one."""
    of = np.array([
        int(_of_frame(data, k, "SegmentIdentificationSequence", "ReferencedSegmentNumber")) for k in range(len(frames))
    ])  # fmt: skip
    kind = np.uint8 if max(names) < 256 else np.uint16
    layers, listed = [np.zeros(shape, kind)], []
    for number, name in sorted(names.items()):
        its = [(frames[k].T != 0, place[k]) for k in np.flatnonzero(of == number)]
        free = next((n for n, layer in enumerate(layers) if not any(layer[:, :, k][on].any() for on, k in its)), None)
        if free is None:
            if (len(layers) + 1) * layers[0].size > MOST_VOXELS:
                raise ValueError(f"its segments overlap in more than {len(layers)} layers. Write fewer into one file")
            free = len(layers)
            layers.append(np.zeros(shape, kind))
        for on, k in its:
            layers[free][:, :, k][on] = number
        listed.append(Segment(number, name, free, number))
    return np.stack(layers), listed
