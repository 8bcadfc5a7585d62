"""The header of a NIfTI file (.nii, .nii.gz; versions 1 and 2), read by nibabel from its first bytes.

Its coordinates are x to the right, y to the front, z to the head, in the unit that the header names, by default mm. The
affine is that of `sform`, else of `qform`. Names of labels: the table of an extension of Connectome Workbench, as
TotalSegmentator writes it.
"""

import gzip
import io
import re
from pathlib import Path

import numpy as np

from palpate.physics.segmentation.voxels import MOST_HEAD, Layout

UNITS = {"meter": 1e3, "micron": 1e-3}  # [mm]
_LABEL = re.compile(r'<Label\b[^>]*\bKey="(\d+)"[^>]*>\s*(?:<!\[CDATA\[)?([^<\]]*)')


def read_nifti(path: Path) -> Layout:
    """ValueError: what is wrong. Errors of nibabel: a damaged header."""
    import nibabel

    packed = path.name.lower().endswith(".gz")
    with gzip.open(path, "rb") if packed else path.open("rb") as file:
        head = file.read(4)
        size = next((n for n in (348, 540) if head in (n.to_bytes(4, "little"), n.to_bytes(4, "big"))), 0)
        if not size:
            raise ValueError("it does not begin with the size of a NIfTI header, 348 or 540")
        head += file.read(size - 4)
        kind = nibabel.Nifti1Header if size == 348 else nibabel.Nifti2Header
        begin = int(kind.from_fileobj(io.BytesIO(head + bytes(4)), check=False).get_data_offset())
        if not size <= begin <= MOST_HEAD:
            raise ValueError(f"its voxels begin at byte {begin}, expected {size} to {MOST_HEAD}")
        head += file.read(begin - size)
    header = kind.from_fileobj(io.BytesIO(head.ljust(begin, b"\0")), check=False)  # a check repairs, and logs it
    shape = tuple(int(n) for n in header.get_data_shape())
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) != 3:
        raise ValueError(f"it has {len(shape)} dimensions, expected one volume of three")
    slope, summand = header.get_slope_inter()
    placed = int(header["sform_code"]) > 0 or int(header["qform_code"]) > 0
    notes = () if placed else ("its header states no orientation: left and right may be interchanged",)
    text = b" ".join(bytes(each.get_content() or b"") for each in header.extensions if each.get_code() != 2)
    unit = UNITS.get(header.get_xyzt_units()[0], 1.0)
    return Layout(
        shape, header.get_data_dtype(), unit * np.asarray(header.get_best_affine(), float)[:3],
        "gzip" if packed else "raw", skip=begin, notes=notes,
        scale=(1.0, 0.0) if slope is None else (float(slope), float(summand or 0.0)),
        names={int(key): name.strip() for key, name in _LABEL.findall(text.decode(errors="replace"))},
    )  # fmt: skip
