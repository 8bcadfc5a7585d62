"""Reads an image of labels: NIfTI, NRRD, MetaImage, DICOM segmentation."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.physics.errors import MeshError
from palpate.physics.extras import require_extra
from palpate.physics.readable import check_file
from palpate.physics.segmentation.dicom import read_dicom
from palpate.physics.segmentation.endings import FORMATS, ending_of
from palpate.physics.segmentation.image import LabelImage
from palpate.physics.segmentation.metaimage import read_metaimage
from palpate.physics.segmentation.nifti import read_nifti
from palpate.physics.segmentation.nrrd import read_nrrd
from palpate.physics.segmentation.voxels import MOST_FILE, Layout, read_voxels

HEADERS: dict[str, Callable[[Path], Layout]] = {
    ".nii": read_nifti, ".nii.gz": read_nifti, ".nrrd": read_nrrd, ".mha": read_metaimage,
}  # fmt: skip
LONGEST = 300  # characters of the text of a library
SHEAR = 0.01  # [1] largest cosine of the angle between two axes of the voxels


def read_labels(path: str | Path) -> LabelImage:
    """The labels in a file.

    MeshError: no file, another format, no labels, no spacing, cut off, too large; the extra `scan` is missing.
    """
    file = Path(path).expanduser()
    ending = ending_of(file)
    if not ending:
        raise MeshError(f"{path}: found {file.suffix or 'no ending'!r}, expected one of {', '.join(FORMATS)}")
    try:
        held = check_file(file, MOST_FILE)
    except OSError as error:
        raise MeshError(f"{path}: {error.strerror} (looked in {Path.cwd()})") from None
    with require_extra(f"{path}", "scan", MeshError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pydicom and pynrrd warn of values that are checked here
        try:
            if ending == ".dcm":
                layout, layers = read_dicom(file)
            else:
                layout = HEADERS[ending](file)
                layers = read_voxels(file, layout, held)
            affine = _checked(layout.affine)
        except (ImportError, MemoryError):
            raise
        except Exception as error:  # the libraries raise many types; all mean an unreadable file
            text = " ".join(str(error).split())[:LONGEST] or "it is damaged"
            raise MeshError(f"{path} is not a readable segmentation ({ending}): {text}") from None
    return LabelImage(str(path), layers, 1e-3 * affine, layout.listed, layout.names, layout.notes)


def _checked(affine: np.ndarray) -> np.ndarray:
    """ValueError: an affine (3,4) without sizes, or with axes that are not at right angles."""
    sides = np.linalg.norm(affine[:, :3], axis=0)
    if not (np.isfinite(affine).all() and (sides > 0.0).all()):
        raise ValueError("it has no spacing of its voxels along an axis. Write its header again")
    axes = affine[:, :3] / sides
    if np.abs(axes.T @ axes - np.eye(3)).max() > SHEAR:
        raise ValueError("the axes of its voxels are not at right angles. Resample it")
    return affine
