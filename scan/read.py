"""Reading a stack of cross-sections: DICOM series, NIfTI, or numbered PNG and TIFF images with a given spacing."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

PICTURES = (".png", ".tif", ".tiff")
IN_PLANE = (0.02e-3, 1.0e-3)
BETWEEN = (0.05e-3, 5.0e-3)
LEAST_SLICES = 6


class ScanError(ValueError):
    """A scan that cannot be used; says where, what was found, what was expected and what would work."""


@dataclass(frozen=True)
class Stack:
    """Cross-sections of a finger.

    volume   [1]  (slices, rows, columns) float32 brightness
    spacing  [m]  between slices, rows, columns
    source   where it came from
    """

    volume: np.ndarray
    spacing: tuple[float, float, float]
    source: str = ""


def read(path: str | Path, spacing: tuple[float, float, float] | None = None) -> Stack:
    """The stack in a file (.nii, .nii.gz, .tif) or a folder (DICOM series, or numbered .png, .tif images).

    spacing  [m] between slices, rows, columns; needed for images, and takes the place of what DICOM or NIfTI say

    ScanError: nothing to read, missing slices, slices of different size or spacing, a spacing that no finger scan has.
    """
    path = Path(path)
    if not path.exists():
        raise ScanError(f"{path}: no such file or folder. Expected a DICOM folder, .nii(.gz), or numbered .png or .tif")
    if path.is_file():
        name = path.name.lower()
        if name.endswith((".nii", ".nii.gz")):
            volume, found = _nifti(path)
        elif name.endswith((".tif", ".tiff")):
            volume, found = _pages(path), None
        else:
            raise ScanError(f"{path}: not a stack. Expected a folder, .nii, .nii.gz, or a .tif of many pages")
    else:
        files = sorted(f for f in path.iterdir() if f.is_file() and not f.name.startswith("."))
        pictures = [f for f in files if f.suffix.lower() in PICTURES]
        volume, found = (_images(path, pictures), None) if pictures else _dicom(path, files)
    used = spacing or found
    if used is None:
        raise ScanError(f"{path}: images have no spacing. Give it as slice,row,column in mm, such as 1.2,0.23,0.23")
    return checked(Stack(np.ascontiguousarray(volume, dtype=np.float32), used, str(path)))


def checked(stack: Stack) -> Stack:
    """The stack itself. ScanError: too few or empty slices, or a spacing that no scan of a finger has."""
    volume, spacing, where = stack.volume, stack.spacing, stack.source
    if volume.ndim != 3 or volume.shape[0] < LEAST_SLICES or min(volume.shape[1:]) < 16:
        raise ScanError(f"{where}: found {volume.shape} (slices, rows, columns), expected {LEAST_SLICES} slices or "
                        f"more of 16 × 16 or more pixels")  # fmt: skip
    if not np.isfinite(volume).all():
        raise ScanError(f"{where}: brightness that is not a number")
    limits = (BETWEEN, IN_PLANE, IN_PLANE)
    for name, value, (low, high) in zip(("slice", "row", "column"), spacing, limits, strict=True):
        if not low <= value <= high:
            raise ScanError(f"{where}: {name} spacing {value * 1e3:g} mm, expected {low * 1e3:g} ... {high * 1e3:g} mm "
                            f"for a finger; give the right one with --spacing")  # fmt: skip
    empty = np.flatnonzero(np.ptp(volume, axis=(1, 2)) == 0)
    if len(empty):
        raise ScanError(f"{where}: slices {_some(empty)} are empty; a slice is missing from the scan")
    return stack


def _some(numbers) -> str:
    text = ", ".join(str(int(n)) for n in numbers[:5])
    return text + (", ..." if len(numbers) > 5 else "")


def _nifti(path: Path):
    import nibabel

    try:
        image: Any = nibabel.load(path)
        data = np.squeeze(np.asanyarray(image.dataobj).astype(np.float32))
    except Exception as error:  # nibabel and its compressors raise many types; all mean the same to the user
        raise ScanError(f"{path}: cannot be read as NIfTI: {error}") from None
    if data.ndim != 3:
        raise ScanError(f"{path}: found {data.ndim} dimensions, expected one volume of three")
    unit = {"meter": 1.0, "micron": 1e-6}.get(image.header.get_xyzt_units()[0], 1e-3)
    zooms = [float(z) * unit for z in image.header.get_zooms()[:3]]
    along = int(np.argmax(zooms)) if max(zooms) > 1.01 * min(zooms) else 2
    row, column = (k for k in (1, 0, 2) if k != along) if along == 2 else sorted({0, 1, 2} - {along}, reverse=True)
    volume = data.transpose(along, row, column)
    # NIfTI rows grow upwards (to superior or anterior), those of an image downwards.
    return volume[:, ::-1], (zooms[along], zooms[row], zooms[column])


def _pages(path: Path):
    from skimage.io import imread

    try:
        data = imread(path)
    except Exception as error:  # as above: many readers, many types
        raise ScanError(f"{path}: cannot be read as TIFF: {error}") from None
    if data.ndim != 3 or data.shape[-1] in (3, 4):
        raise ScanError(f"{path}: found shape {data.shape}, expected pages × rows × columns in grey")
    return data


def _images(folder: Path, files: list[Path]):
    from skimage.io import imread

    numbered = []
    for file in files:
        numbers = re.findall(r"\d+", file.stem)
        if not numbers:
            raise ScanError(f"{file}: no number in its name; slices are put in order by the last number")
        numbered.append((int(numbers[-1]), file))
    numbered.sort()
    steps = sorted(b - a for (a, _), (b, _) in pairwise(numbered))
    usual = steps[len(steps) // 2] if steps else 1
    for (a, before), (b, after) in pairwise(numbered):
        if b - a != usual:
            raise ScanError(f"{folder}: from {before.name} to {after.name} the number goes up by {b - a}, elsewhere by "
                            f"{usual}: a slice is missing or there twice")  # fmt: skip
    slices = []
    for _, file in numbered:
        try:
            image = imread(file)
        except Exception as error:  # as above
            raise ScanError(f"{file}: cannot be read: {error}") from None
        slices.append(image[..., :3].mean(axis=-1) if image.ndim == 3 else image)
        if slices[-1].shape != slices[0].shape:
            raise ScanError(f"{file}: {slices[-1].shape} pixels, the first slice has {slices[0].shape}")
    return np.stack(slices)


def _dicom(folder: Path, files: list[Path]):
    import pydicom

    series: dict[str, list] = {}
    for file in files:
        try:
            data = pydicom.dcmread(file)
        except (pydicom.errors.InvalidDicomError, OSError):
            continue
        if "PixelData" in data:
            series.setdefault(str(data.get("SeriesInstanceUID", "")), []).append(data)
    if not series:
        raise ScanError(f"{folder}: no DICOM, PNG or TIFF images in it")
    if len(series) > 1:
        counts = ", ".join(f"{len(s)} of …{uid[-12:]}" for uid, s in series.items())
        raise ScanError(f"{folder}: {len(series)} series ({counts}), expected one; put each in a folder of its own")
    slices = next(iter(series.values()))
    for name in ("PixelSpacing", "ImagePositionPatient", "ImageOrientationPatient"):
        if any(s.get(name) is None for s in slices):
            raise ScanError(f"{folder}: {name} is missing; convert to NIfTI, or to images with a given spacing")
    if any(int(s.get("NumberOfFrames", 1)) > 1 for s in slices):
        raise ScanError(f"{folder}: enhanced DICOM with many frames a file; convert it to NIfTI")
    for name in ("PixelSpacing", "ImageOrientationPatient", "Rows", "Columns"):
        if any(not np.allclose(s.get(name), slices[0].get(name), rtol=1e-4, atol=1e-4) for s in slices):
            raise ScanError(f"{folder}: {name} differs from slice to slice, expected one for the series")
    turn = np.array(slices[0].ImageOrientationPatient, float)
    normal = np.cross(turn[:3], turn[3:])
    placed = sorted(((float(np.dot(normal, np.array(s.ImagePositionPatient, float))), s) for s in slices),
                    key=lambda pair: pair[0])  # fmt: skip
    places = np.array([p for p, _ in placed])
    gaps = np.diff(places)
    usual = float(np.median(gaps)) if len(gaps) else 0.0
    wrong = np.flatnonzero(np.abs(gaps - usual) > 0.05 * abs(usual) + 1e-3)
    if len(wrong):
        k = int(wrong[0])
        raise ScanError(f"{folder}: {gaps[k]:.3f} mm between slices {k + 1} and {k + 2} of {len(placed)}, elsewhere "
                        f"{usual:.3f} mm: a slice is missing or there twice")  # fmt: skip
    try:
        volume = np.stack([s.pixel_array * float(s.get("RescaleSlope", 1)) + float(s.get("RescaleIntercept", 0))
                           for _, s in placed])  # fmt: skip
    except Exception as error:  # pixel decoders raise many types
        raise ScanError(f"{folder}: pixels cannot be decoded: {error}") from None
    row, column = (float(v) * 1e-3 for v in slices[0].PixelSpacing)
    return volume, (usual * 1e-3, row, column)
