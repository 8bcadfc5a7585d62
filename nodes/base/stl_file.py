"""Reading STL files that deviate from the format: a wrong count, trailing bytes, another last line.

Binary: 80 bytes, number of triangles (uint32), per triangle 50 bytes: normal, three corners (12 float32), 2 bytes.
Text: `solid`, per triangle `facet normal`, `outer loop`, three lines `vertex x y z`, ..., and a last line that differs
between programs and is not needed. Words may be in capitals.
"""

import re
from pathlib import Path

import numpy as np

HEAD, EACH = 84, 50  # [bytes]
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.IGNORECASE | re.MULTILINE)
_ANY = re.compile(rb"^\s*vertex\b.*$", re.IGNORECASE | re.MULTILINE)
_FACETS = re.compile(rb"^\s*facet\b", re.IGNORECASE | re.MULTILINE)


def read_stl(file: Path) -> tuple[np.ndarray, list[str]]:
    """Corners of the triangles (T,3,3), in the file's unit, and a line per deviation. ValueError: what is wrong."""
    data = file.read_bytes()
    if re.match(rb"(\xef\xbb\xbf)?\s*solid", data, re.IGNORECASE) and _FACETS.search(data):
        return _text(data)
    if len(data) < HEAD + EACH:
        raise ValueError(f"it has {len(data)} bytes; the shortest STL file, of one triangle, has {HEAD + EACH}")
    announced, room = int.from_bytes(data[80:84], "little"), (len(data) - HEAD) // EACH
    rest = len(data) - HEAD - EACH * announced
    if announced > room:
        raise ValueError(
            f"its header announces {announced} triangles, its {len(data)} bytes have room for {room}: it is cut off or "
            "damaged. Export it again"
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
    corners = np.frombuffer(data, _FACET, count, HEAD)["corners"].astype(float)
    return corners, notes


def _text(data: bytes) -> tuple[np.ndarray, list[str]]:
    found, lines, facets = _VERTEX.findall(data), len(_ANY.findall(data)), len(_FACETS.findall(data))
    if len(found) < lines:
        bad = next(line for line in _ANY.findall(data) if not _VERTEX.match(line))
        raise ValueError(f"found {bad.decode(errors='replace').strip()!r}, expected `vertex` and three numbers")
    if len(found) != 3 * facets:
        raise ValueError(
            f"it has {facets} facets and {len(found)} corners, expected {3 * facets}: it is cut off or damaged. Export "
            "it again"
        )
    try:
        corners = np.array(found).astype(float).reshape(-1, 3, 3)
    except ValueError as error:
        raise ValueError(f"a corner is not three numbers with a decimal point: {error}") from None
    ended = re.search(rb"^\s*endsolid", data, re.IGNORECASE | re.MULTILINE)
    last = data.rstrip().rsplit(b"\n", 1)[-1].strip().decode(errors="replace")[:40]
    return corners, [] if ended else [
        f"its last line is {last!r} instead of `endsolid`; its {facets} triangles are read"
    ]
