"""The header of an NRRD file (.nrrd), read by pynrrd from its first bytes; also .seg.nrrd of 3D Slicer.

`space` names the axes of its coordinates, in mm unless `space units` says otherwise. 3D Slicer writes the segments as
`Segment0_Name`, `Segment0_LabelValue` and `Segment0_Layer`; overlapping ones are in separate layers, the first axis.
"""

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.segmentation.image import Segment
from palpate.physics.segmentation.voxels import MOST_HEAD, Layout
from palpate.units.header import factor

RIGHT, FRONT = {"right": 1.0, "left": -1.0}, {"anterior": 1.0, "posterior": -1.0}
SPACES = {"ras": "right-anterior-superior", "las": "left-anterior-superior", "lps": "left-posterior-superior"}
TYPES = {
    "i1": ("signed char", "int8", "int8_t"), "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"), "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": ("longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",), "f8": ("double",),
}  # fmt: skip
ENCODINGS = {"raw": "raw", "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}


def read_nrrd(path: Path) -> Layout:
    """ValueError: what is wrong. Errors of pynrrd: a damaged header."""
    import nrrd

    with path.open("rb") as file:
        head = file.read(MOST_HEAD)
    end = re.search(rb"\r?\n\r?\n", head)
    if not head.startswith(b"NRRD") or end is None:
        raise ValueError("it does not begin with a line NRRD000n and a header that ends with an empty line")
    header: dict[str, Any] = dict(nrrd.read_header(io.BytesIO(head[: end.end()])))
    if "data file" in header or "datafile" in header:
        raise ValueError("its voxels are in another file, which is not opened. Save both as one file (.nrrd)")
    if (encoding := ENCODINGS.get(str(header.get("encoding")).lower())) is None:
        raise ValueError(f"its encoding is {header.get('encoding')}, expected raw or gzip")
    if any(int(header.get(f"{what} skip", 0)) for what in ("line", "byte")):
        raise ValueError("it skips a part of its voxels (line skip, byte skip). Save it again without")
    kind = next((kind for kind, names in TYPES.items() if header.get("type") in names), None)
    if kind is None:
        raise ValueError(f"its type is {header.get('type')}, expected whole numbers")
    order = ">" if header.get("endian") == "big" else "<"
    shape = tuple(int(n) for n in header.get("sizes", ()))
    affine, layered = _affine(header, shape)
    notes = () if header.get("space") in {*SPACES.values(), *map(str.upper, SPACES), *SPACES} else (
        "its header names no axes of the body (space): left and right may be interchanged",
    )  # fmt: skip
    return Layout(
        shape, np.dtype(order + kind), affine, encoding, end.end(), listed=tuple(_segments(header, layered)),
        notes=notes,
    )  # fmt: skip


def _affine(header: dict[str, Any], shape: tuple[int, ...]) -> tuple[np.ndarray, bool]:
    """From indices [mm] (3,4), and whether the first axis counts layers. ValueError: no spacing, other dimensions."""
    given = header.get("space directions")
    rows = [np.full(3, np.nan) if row is None else np.asarray(row, float) for row in ([] if given is None else given)]
    layered = len(shape) == 4 and len(rows) == 4 and bool(np.isnan(rows[0]).all())
    if len(shape) != 3 + layered:
        raise ValueError(f"it has {len(shape)} dimensions, expected one volume of three")
    if not rows and header.get("spacings") is not None:
        rows = list(np.diag(np.asarray(header["spacings"], float)))
    axes = np.array(rows[-3:]) if rows else np.zeros(0)
    if axes.shape != (3, 3) or not np.isfinite(axes).all():
        raise ValueError("it has no spacing of its voxels. Expected `space directions` or `spacings` in its header")
    origin = np.asarray(header.get("space origin", np.zeros(3)), float)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise ValueError(f"its space origin is {header.get('space origin')}, expected three numbers")
    words = SPACES.get(str(header.get("space", "")).lower(), str(header.get("space", ""))).lower().split("-")
    turn = np.array([RIGHT.get(words[0], 1.0), FRONT.get(words[1], 1.0) if len(words) > 1 else 1.0, 1.0])
    unit = np.array([factor(each, "mm") for each in header.get("space units", ["mm"] * 3)])
    return (unit * turn)[:, None] * np.column_stack([axes.T, origin]), layered


def _segments(header: dict[str, Any], layered: bool) -> list[Segment]:
    """The segments of 3D Slicer; numbered from 1 where several layers have the same values."""
    found = []
    for k in range(len(header)):
        if f"Segment{k}_LabelValue" not in header:
            break
        value, layer = (int(header.get(f"Segment{k}_{name}", 0)) for name in ("LabelValue", "Layer"))
        found.append(Segment(value, str(header.get(f"Segment{k}_Name", "")), layer if layered else 0, value))
    if len({each.value for each in found}) < len(found):
        found = [each._replace(number=k + 1) for k, each in enumerate(found)]
    return found
