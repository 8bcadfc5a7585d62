"""The header of a MetaImage file (.mha): lines `Key = value`, the last one is ElementDataFile = LOCAL.

Read here, because the libraries that read it are either ITK, which also opens other files that a header names, or call
it. Its coordinates are those of ITK: x to the left, y to the back, z to the head, in mm; a row of TransformMatrix is
the direction of an axis of the voxels. `tests/physics/segmentation` compares with SimpleITK.
"""

from pathlib import Path

import numpy as np

from palpate.physics.segmentation.voxels import Layout

LONGEST = 1 << 16  # [bytes] of the header
TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip
FROM_ITK = np.array([-1.0, -1.0, 1.0])  # to x to the right, y to the front


def read_metaimage(path: Path) -> Layout:
    """ValueError: what is wrong."""
    with path.open("rb") as file:
        head = file.read(LONGEST)
    keys: dict[str, str] = {}
    at = 0
    while "ElementDataFile" not in keys:
        end = head.find(b"\n", at)
        if end < 0:
            raise ValueError("its header has no line ElementDataFile: it is cut off or no MetaImage")
        name, equals, value = head[at:end].decode(errors="replace").partition("=")
        if not equals:
            raise ValueError(f"its header has the line {name.strip()[:40]!r}, expected Key = value")
        keys[name.strip()] = value.strip()
        at = end + 1
    if keys["ElementDataFile"].upper() != "LOCAL":
        raise ValueError("its voxels are in another file, which is not opened. Save both as one file (.mha)")
    if keys.get("NDims") != "3" or keys.get("ElementNumberOfChannels", "1") != "1":
        numbers = keys.get("ElementNumberOfChannels", "1")
        raise ValueError(
            f"it has {keys.get('NDims')} dimensions and {numbers} numbers per voxel, expected 3 and 1: one volume"
        )
    if keys.get("ElementType") not in TYPES:
        raise ValueError(f"its ElementType is {keys.get('ElementType')}, expected whole numbers")
    if keys.get("HeaderSize", "0") not in ("0", "-1") or not _is(keys, "BinaryData", True):
        raise ValueError("its voxels are text, or begin elsewhere. Save it again, in binary")
    if "ElementSpacing" not in keys:
        raise ValueError("it has no spacing of its voxels. Expected a line ElementSpacing")
    shape = _numbers(keys, "DimSize", 3, "")
    axes = _numbers(keys, "TransformMatrix", 9, "1 0 0 0 1 0 0 0 1").reshape(3, 3)
    origin = _numbers(keys, "Offset" if "Offset" in keys else "Position", 3, "0 0 0")
    affine = np.column_stack([axes.T * _numbers(keys, "ElementSpacing", 3, ""), origin])
    msb = _is(keys, "BinaryDataByteOrderMSB", False) or _is(keys, "ElementByteOrderMSB", False)
    return Layout(
        tuple(int(n) for n in shape), np.dtype((">" if msb else "<") + TYPES[keys["ElementType"]]),
        FROM_ITK[:, None] * affine, "zlib" if _is(keys, "CompressedData", False) else "raw", at,
    )  # fmt: skip


def _is(keys: dict[str, str], name: str, default: bool) -> bool:
    return keys.get(name, str(default)).lower() == "true"


def _numbers(keys: dict[str, str], name: str, count: int, default: str) -> np.ndarray:
    words = keys.get(name, default).split()
    try:
        found = np.array([float(word) for word in words])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count or not np.isfinite(found).all():
        raise ValueError(f"its {name} is {' '.join(words)[:60]!r}, expected {count} numbers")
    return found
