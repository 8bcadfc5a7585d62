"""Triangles of mesh files as they are: STL, PLY, OBJ; STL files that deviate from the format: a wrong count, trailing
bytes, another last line.

Binary STL: 80 bytes, number of triangles (uint32), per triangle 50 bytes: normal, three corners (12 float32), 2 bytes.
Text STL: `solid`, per triangle `facet normal`, `outer loop`, three lines `vertex x y z`, ..., and a last line that
differs between programs and is not needed. Words may be in capitals.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from palpate.nodes.base import SettingError
from palpate.physics.extras import missing

FORMATS = (".stl", ".ply", ".obj")
LARGEST_FILE = 1 << 28  # [bytes] 5 million triangles of a binary STL; reading takes ten times as much memory
AGAIN = "Export it again, as a binary STL"
HEAD, EACH = 84, 50  # [bytes] of a binary STL
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.IGNORECASE | re.MULTILINE)
_ANY = re.compile(rb"^\s*vertex\b.*$", re.IGNORECASE | re.MULTILINE)
_FACETS = re.compile(rb"^\s*facet\b", re.IGNORECASE | re.MULTILINE)


def read_file(path: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Vertices (V,3) and triangles (T,3) as in the file, and its deviations from its format.

    SettingError: no file, another format, too large, damaged, without triangles, or trimesh is not installed.
    """
    file = Path(path).expanduser()
    ending = file.suffix.lower()
    if ending not in FORMATS:
        raise SettingError(
            f"setting 'surface': {path}: format {file.suffix!r}, expected one of {', '.join(FORMATS)}. {AGAIN}"
        )
    if not file.is_file():
        what = f"{path} is a folder, expected a mesh file" if file.is_dir() else f"no file {path}"
        raise SettingError(f"setting 'surface': {what} (looked in {Path.cwd()})")
    size = file.stat().st_size
    if size > LARGEST_FILE:
        raise SettingError(
            f"setting 'surface': {path} has {size / 1e6:.0f} MB, expected at most {LARGEST_FILE / 1e6:.0f} MB. Give it"
            " fewer triangles."
        )
    if not size:
        raise SettingError(f"setting 'surface': {path} contains no triangles: it has 0 bytes. {AGAIN}")
    try:
        import trimesh
    except ImportError as error:
        raise SettingError(missing(f"setting 'surface': {path}", error.name, "mesh")) from None
    fault, other = "", _content_of(file, size)
    try:
        mesh: Any = trimesh.load(file, force="mesh", process=False)
        if len(triangles := np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)):
            return np.array(mesh.vertices, dtype=float).reshape(-1, 3), triangles, []
    except Exception as error:  # the reader may raise any exception for a damaged file
        fault = str(error).splitlines()[0].rstrip(".!") if str(error) else type(error).__name__
    if ending == ".stl" and other in ("", ending):
        try:
            corners, notes = read_stl(file)  # which trimesh refuses
            return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), notes
        except ValueError as error:
            fault = str(error)
    if other not in ("", ending):
        raise SettingError(
            f"setting 'surface': {path} is no {ending} file: its content is that of a {other} file. "
            + (f"Rename it to {file.stem}{other}" if other in FORMATS else AGAIN)
        )
    if fault:
        raise SettingError(f"setting 'surface': {path} is not a readable {ending} file: {fault}. {AGAIN}")
    raise SettingError(f"setting 'surface': {path} contains no triangles. {AGAIN}")


def _content_of(file: Path, size: int) -> str:
    """The format that the first bytes of a file show, as an ending; "": none of the known."""
    with file.open("rb") as stream:
        head = stream.read(HEAD)
    if len(head) == HEAD and size == HEAD + EACH * int.from_bytes(head[80:], "little"):
        return ".stl"
    for start, ending in ((b"ply", ".ply"), (b"solid", ".stl"), (b"glTF", ".glb"), (b"OFF", ".off"), (b"PK", ".zip")):
        if head.lstrip().startswith(start):
            return ending
    return ""


def read_stl(file: Path) -> tuple[np.ndarray, list[str]]:
    """Corners of the triangles (T,3,3), in the file's unit, and a line per deviation. ValueError: what is wrong."""
    data = file.read_bytes()
    if re.match(rb"(\xef\xbb\xbf)?\s*solid", data, re.IGNORECASE):
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
    corners = np.frombuffer(data, _FACET, count, HEAD)["corners"].astype(float)
    return corners, notes


def _text(data: bytes) -> tuple[np.ndarray, list[str]]:
    found, lines, facets = _VERTEX.findall(data), len(_ANY.findall(data)), len(_FACETS.findall(data))
    if len(found) < lines:
        bad = next(line for line in _ANY.findall(data) if not _VERTEX.match(line))
        cut = ": it is cut off" if data.rstrip().endswith(bad.strip()) else ""
        raise ValueError(f"found {bad.decode(errors='replace').strip()!r}, expected `vertex` and three numbers{cut}")
    if len(found) != 3 * facets:
        raise ValueError(
            f"it has {facets} facets and {len(found)} corners, expected {3 * facets}: it is cut off or damaged"
        )
    try:
        corners = np.array(found).astype(float).reshape(-1, 3, 3)
    except ValueError:
        bad = next(corner for corner in found if not all(map(_is_number, corner)))
        text = b" ".join(bad).decode(errors="replace")
        raise ValueError(f"the corner {text!r} is not three numbers with a decimal point") from None
    ended = re.search(rb"^\s*endsolid", data, re.IGNORECASE | re.MULTILINE)
    last = data.rstrip().rsplit(b"\n", 1)[-1].strip().decode(errors="replace")[:40]
    return corners, [] if ended else [
        f"its last line is {last!r} instead of `endsolid`; its {facets} triangles are read"
    ]


def _is_number(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
