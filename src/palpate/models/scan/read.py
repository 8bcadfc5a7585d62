"""Reading a stack of cross-sections: DICOM series or NIfTI."""

import dataclasses
import gzip
import io
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np

from palpate.models.scan.stack import ScanError, Stack, check_stack, cross_sections, orient_stack
from palpate.physics.claims import check_claim
from palpate.physics.readable import check_file

MOST_VOXELS = 1 << 28  # [1] limit of a stack: 1 GB in memory, 4 l at 0.25 mm
MOST_FILE = 1 << 30  # [bytes] limit of all files of a DICOM series together
MOST_HEAD = 1 << 24  # [bytes] limit of the data before the voxels of a NIfTI file
DEFLATED = b"1.2.840.10008.1.2.1.99"  # Transfer syntax of deflated DICOM files


def read(path: str | Path, spacing: tuple[float, float, float] | None = None, axes: str = "") -> Stack:
    """The stack in a file (.nii, .nii.gz) or a folder (DICOM series).

    spacing  [m] between slices, rows, columns of the cross-sections; replaces that of the header
    axes     directions of slices, rows and columns, see `scan.stack`; replaces those of the header

    The slices of the result are cross-sections of the finger for any orientation of the file.

    ScanError: nothing to read, missing slices, slices of different size or spacing, implausible spacing, invalid axes.
    """
    path = Path(path)
    if not path.exists():
        raise ScanError(f"{path}: no such file or folder. Expected a DICOM folder or .nii(.gz)")
    if path.is_dir():
        files = sorted(f for f in path.iterdir() if f.is_file() and not f.name.startswith("."))
        try:
            volume, stated, mirrored = _series(path, files)
        except ScanError:
            raise
        except Exception as error:  # pydicom parses a value when it is accessed, and raises many types
            raise ScanError(f"{path}: cannot be read as DICOM: {error}") from None
    elif path.name.lower().endswith((".nii", ".nii.gz")):
        volume, stated, mirrored = _nifti(path)
    else:
        raise ScanError(
            f"{path}: not a stack. Expected a folder of DICOM files, .nii or .nii.gz; convert images to NIfTI"
        )
    stack = cross_sections(orient_stack(Stack(np.asarray(volume, dtype=np.float32), stated, str(path)), axes, mirrored))
    return check_stack(stack if spacing is None else dataclasses.replace(stack, spacing=spacing))


def _nifti(path: Path):
    import nibabel

    try:
        held = check_file(path, MOST_FILE)
        _check_head(path)
        image: Any = nibabel.load(path)
        _check_voxels(math.prod(map(int, image.shape)))
        claimed = math.prod(map(int, image.shape)) * int(image.get_data_dtype().itemsize)
        if path.name.lower().endswith(".gz"):  # memory is reserved before the voxels are read
            check_claim("its header", claimed, held)
        elif not 0 < claimed <= held:
            raise ValueError(f"its header claims {claimed} bytes of voxels, the file contains at most {held}")
        unit = {"meter": 1.0, "micron": 1e-6}.get(image.header.get_xyzt_units()[0], 1e-3)
        data = np.squeeze(np.asanyarray(image.dataobj).astype(np.float32))
    except Exception as error:  # nibabel and its compressors raise many types; all mean an unreadable file
        raise ScanError(f"{path}: cannot be read as NIfTI: {error}") from None
    if data.ndim != 3:
        raise ScanError(f"{path}: found {data.ndim} dimensions, expected one volume of three")
    turn = np.asarray(image.affine, float)[:3, :3]
    zooms = np.linalg.norm(turn, axis=0)
    if not (np.isfinite(turn).all() and (zooms > 0).all()):
        raise ScanError(
            f"{path}: its affine has no size along an axis; give the spacing and the axes with a new header"
        )
    if np.abs((turn / zooms).T @ (turn / zooms) - np.eye(3)).max() > 0.01:
        raise ScanError(f"{path}: the axes of its affine are not orthogonal; resample the images")
    stated = any(int(image.header[code]) > 0 for code in ("qform_code", "sform_code") if code in image.header)
    # NIfTI rows grow upwards (to superior or anterior), those of an image downwards.
    mirrored = bool(np.linalg.det(turn) > 0) if stated else None
    along, row, column = (float(zooms[k]) * unit for k in (2, 1, 0))
    return data.transpose(2, 1, 0)[:, ::-1], (along, row, column), mirrored


def _check_head(path: Path) -> None:
    """ValueError: implausible offset of the voxels; nibabel would read everything before it as extensions."""
    unpacked = gzip.open if path.name.lower().endswith(".gz") else open
    with unpacked(path, "rb") as file:
        head = file.read(352)
    for order in "<>":
        if head[:4] == struct.pack(f"{order}i", 348):
            begin = struct.unpack_from(f"{order}f", head, 108)[0]
        elif head[:4] == struct.pack(f"{order}i", 540):
            begin = struct.unpack_from(f"{order}q", head, 168)[0]
        else:
            continue
        if not begin <= MOST_HEAD:
            raise ValueError(f"its voxels begin at byte {begin:g}, expected at most {MOST_HEAD}")


def _check_voxels(count: int) -> None:
    if not 0 < count <= MOST_VOXELS:
        raise ValueError(f"its header claims {count} voxels, expected 1 to {MOST_VOXELS}")


def _series(folder: Path, files: list[Path]):
    slices = _slices(folder, files)
    _check_headers(folder, files, slices)
    placed, spacing = _stack(folder, slices)
    volume = _brightness(folder, placed)
    row, column = (float(v) * 1e-3 for v in slices[0].PixelSpacing)
    return volume, (spacing * 1e-3, row, column), False  # slices in order of columns × rows are right-handed


def _slices(folder: Path, files: list[Path]) -> list[Any]:
    """The images of the only series of a folder. ScanError: none, or several."""
    import pydicom

    series: dict[str, list] = {}
    size = sum(file.stat().st_size for file in files)
    if size > MOST_FILE:
        raise ScanError(f"{folder}: {len(files)} files of {size} bytes together, expected at most {MOST_FILE}")
    for file in files:
        try:
            # From memory: reading from a file allocates as much as a damaged length claims.
            content = file.read_bytes()
            if DEFLATED in content:
                raise ScanError(f"{file}: deflated DICOM, whose size is unknown before decompression; convert it to "
                                "another transfer syntax, or to NIfTI")  # fmt: skip
            data = pydicom.dcmread(io.BytesIO(content))
        except (pydicom.errors.InvalidDicomError, OSError):
            continue
        if "PixelData" in data:
            series.setdefault(str(data.get("SeriesInstanceUID", "")), []).append(data)
    if not series:
        raise ScanError(f"{folder}: no DICOM images in it; convert PNG or TIFF images to NIfTI")
    if len(series) > 1:
        counts = ", ".join(f"{len(s)} of …{uid[-12:]}" for uid, s in series.items())
        raise ScanError(f"{folder}: {len(series)} series ({counts}), expected one; put each in a separate folder")
    return next(iter(series.values()))


def _check_headers(folder: Path, files: list[Path], slices: list[Any]) -> None:
    """ScanError: headers that are incomplete, of several frames, or of different geometry; or claims of a size."""
    for name in ("PixelSpacing", "ImagePositionPatient", "ImageOrientationPatient"):
        if any(s.get(name) is None for s in slices):
            raise ScanError(f"{folder}: {name} is missing; convert to NIfTI")
    if any(int(s.get("NumberOfFrames", 1)) > 1 for s in slices):
        raise ScanError(f"{folder}: enhanced DICOM with many frames a file; convert it to NIfTI")
    pixels = [int(s.Rows) * int(s.Columns) * int(s.get("SamplesPerPixel", 1)) for s in slices]
    _check_voxels(sum(pixels))
    bits = sum(each * int(s.get("BitsAllocated", 16)) for each, s in zip(pixels, slices, strict=True))
    check_claim("the series", bits // 8, sum(file.stat().st_size for file in files))
    for name in ("PixelSpacing", "ImageOrientationPatient", "Rows", "Columns"):
        if any(not np.allclose(s.get(name), slices[0].get(name), rtol=1e-4, atol=1e-4) for s in slices):
            raise ScanError(f"{folder}: {name} differs from slice to slice, expected one for the series")


def _stack(folder: Path, slices: list[Any]) -> tuple[list[Any], float]:
    """The slices in order along their normal, and their spacing [mm]. ScanError: it varies, or the stack is oblique."""
    turn = np.array(slices[0].ImageOrientationPatient, float)
    normal = np.cross(turn[:3], turn[3:])
    placed = sorted(((float(np.dot(normal, np.array(s.ImagePositionPatient, float))), s) for s in slices),
                    key=lambda pair: pair[0])  # fmt: skip
    places = np.array([p for p, _ in placed])
    aside = np.array([np.array(s.ImagePositionPatient, float) - p * normal for p, s in placed])
    if np.abs(aside - aside[0]).max() > 0.1 * max(float(v) for v in slices[0].PixelSpacing):
        raise ScanError(
            f"{folder}: the slices are not perpendicular to the direction of the stack; resample the images"
        )
    gaps = np.diff(places)
    usual = float(np.median(gaps)) if len(gaps) else 0.0
    wrong = np.flatnonzero(np.abs(gaps - usual) > 0.05 * abs(usual) + 1e-3)
    if len(wrong):
        k = int(wrong[0])
        raise ScanError(f"{folder}: {gaps[k]:.3f} mm between slices {k + 1} and {k + 2} of {len(placed)}, elsewhere "
                        f"{usual:.3f} mm: a slice is missing or repeated")  # fmt: skip
    return [s for _, s in placed], usual


def _brightness(folder: Path, slices: list[Any]) -> np.ndarray:
    """The voxels of the slices. ScanError: they cannot be decoded, or are not grey."""
    try:
        volume = np.stack([(s.pixel_array * float(s.get("RescaleSlope", 1)) + float(s.get("RescaleIntercept", 0)))
                           .astype(np.float32) for s in slices])  # fmt: skip
    except Exception as error:  # pixel decoders raise many types
        raise ScanError(f"{folder}: pixels cannot be decoded: {error}") from None
    kinds = {str(s.get("PhotometricInterpretation", "MONOCHROME2")) for s in slices}
    if kinds == {"MONOCHROME1"}:  # its small values are bright
        volume = volume.max() - volume
    elif kinds != {"MONOCHROME2"}:
        raise ScanError(
            f"{folder}: pixels of {', '.join(sorted(kinds))}, expected grey ones, MONOCHROME1 or MONOCHROME2"
        )
    return volume
