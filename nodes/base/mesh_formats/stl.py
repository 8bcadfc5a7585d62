"""Triangles of an STL file, also of one that deviates from the format: a wrong count, trailing bytes, no last line.

Binary STL: 80 bytes, number of triangles (uint32), per triangle 50 bytes: normal, three corners (12 float32), 2 bytes.
Text STL: `solid`, per triangle `facet normal`, `outer loop`, three lines `vertex x y z`, ..., and a last line that
differs between programs and is not needed. Words may be in capitals. Normals are not read.
"""

import re

import numpy as np

from palpate.nodes.base.mesh_formats.polygons import FileMesh
from palpate.nodes.base.mesh_formats.words import numbers

HEAD, EACH = 84, 50  # [bytes] of a binary STL
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.IGNORECASE | re.MULTILINE)
_ANY = re.compile(rb"^\s*vertex\b.*$", re.IGNORECASE | re.MULTILINE)
_FACETS = re.compile(rb"^\s*facet\b", re.IGNORECASE | re.MULTILINE)


def is_binary(head: bytes, size: int) -> bool:
    """Whether a file of this size [bytes] that begins with these bytes is a binary STL with the announced length."""
    return len(head) >= HEAD and size == HEAD + EACH * int.from_bytes(head[80:HEAD], "little")


def read_stl(data: bytes) -> FileMesh:
    """The mesh in the bytes of a file. ValueError: what is wrong."""
    if not is_binary(data[:HEAD], len(data)) and re.match(rb"\s*solid", data, re.IGNORECASE):
        lines = data.replace(b"\r", b"\n")
        if _FACETS.search(lines):
            return _text(lines)
    if len(data) < HEAD + EACH:
        raise ValueError(f"it has {len(data)} bytes; the shortest STL file, of one triangle, has {HEAD + EACH}")
    announced, room = int.from_bytes(data[80:84], "little"), (len(data) - HEAD) // EACH
    rest = len(data) - HEAD - EACH * announced
    if announced > room:
        raise ValueError(
            f"its header announces {announced} triangles, its {len(data)} bytes have room for {room}: it is cut off or "
            "damaged"
        )
    count, notes = announced, []
    if announced == 0:
        if (len(data) - HEAD) % EACH:
            raise ValueError(
                f"its header announces 0 triangles, and its other {len(data) - HEAD} bytes are no triangles"
            )
        count = room
        notes.append(f"its header announces 0 triangles; all {count} in the file are read")
    elif rest:
        notes.append(f"{rest} bytes after the {announced} triangles that its header announces are ignored")
    return _mesh(np.frombuffer(data, _FACET, count, HEAD)["corners"].astype(float), notes)


def _text(data: bytes) -> FileMesh:
    found, lines, facets = _VERTEX.findall(data), len(_ANY.findall(data)), len(_FACETS.findall(data))
    if len(found) < lines:
        bad = next(line for line in _ANY.findall(data) if not _VERTEX.match(line))
        cut = ": it is cut off" if data.rstrip().endswith(bad.strip()) else ""
        text = bad.decode(errors="replace").strip()[:60]
        raise ValueError(f"found {text!r}, expected `vertex` and three numbers{cut}")
    if len(found) != 3 * facets:
        raise ValueError(
            f"it has {facets} facets and {len(found)} corners, expected {3 * facets}: it is cut off or damaged"
        )
    try:
        corners = numbers([word for corner in found for word in corner])
    except ValueError:
        bad_corner = next(corner for corner in found if not all(map(_is_number, corner)))
        text = b" ".join(bad_corner).decode(errors="replace")[:60]
        raise ValueError(f"the corner {text!r} is not three numbers with a decimal point") from None
    ended = re.search(rb"^\s*endsolid", data, re.IGNORECASE | re.MULTILINE)
    last = data.rstrip().rsplit(b"\n", 1)[-1].strip().decode(errors="replace")[:40]
    return _mesh(corners.reshape(-1, 3, 3), [] if ended else [
        f"its last line is {last!r} instead of `endsolid`; its {facets} triangles are read"
    ])  # fmt: skip


def _mesh(corners: np.ndarray, notes: list[str]) -> FileMesh:
    """The mesh of triangles with separate corners (T,3,3)."""
    count = len(corners)
    return FileMesh(corners.reshape(-1, 3), np.arange(3 * count), np.full(count, 3), notes)


def _is_number(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
