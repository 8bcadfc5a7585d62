"""Triangles of mesh files as they are: STL, PLY, OBJ.

The files are read here and not by trimesh, which reads other indices than the file has (0, or beyond the last vertex),
opens the materials that a file names, cuts concave polygons as a fan, and refuses valid files: PLY with triangles and
quads, OBJ with tabs or a byte order mark, STL with normals that are no numbers. Memory and time grow with the file, and
sizes that it states are compared with its length first. `tests/nodes/test_mesh_formats.py` compares with trimesh.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.nodes.base import SettingError
from palpate.nodes.base.mesh_formats import stl
from palpate.nodes.base.mesh_formats.obj import read_obj
from palpate.nodes.base.mesh_formats.ply import read_ply
from palpate.nodes.base.mesh_formats.polygons import FileMesh, PolygonError, triangulate
from palpate.nodes.base.mesh_formats.stl import read_stl
from palpate.nodes.base.mesh_formats.words import without_mark
from palpate.physics.readable import check_file
from palpate.physics.segmentation.endings import FORMATS as SEGMENTATIONS
from palpate.physics.segmentation.endings import ending_of

READERS: dict[str, Callable[[bytes], FileMesh]] = {".stl": read_stl, ".ply": read_ply, ".obj": read_obj}
"""Reader of the bytes of a file by its ending; each raises ValueError with what is wrong."""
FORMATS = tuple(READERS)
LARGEST_FILE = 1 << 28  # [bytes] 5 million triangles of a binary STL; reading takes ten times as much memory
AGAIN = "Export it again, as a binary STL"
STARTS = ((b"ply", ".ply"), (b"solid", ".stl"), (b"glTF", ".glb"), (b"OFF", ".off"), (b"PK", ".zip"))


def read_file(path: str) -> tuple[np.ndarray, np.ndarray, list[str], str]:
    """Vertices (V,3) and triangles (T,3) as in the file, its deviations from its format, and whether it may be cut off,
    as a clause ("": it is complete).

    SettingError: no file, another format, too large, damaged, or without triangles.
    """
    file = Path(path).expanduser()
    ending = file.suffix.lower()
    if ending_of(file):
        raise SettingError(
            f"setting 'surface': {path} is a segmentation, expected one of {', '.join(FORMATS)}. Give it as an organ: "
            f"--organ {path} --label NAME, or the key organ: {{file: {path}, label: NAME}}"
        )
    if ending not in FORMATS:
        raise SettingError(
            f"setting 'surface': {path}: format {file.suffix!r}, expected one of {', '.join(FORMATS)}, or as --organ a"
            f" segmentation: {', '.join(SEGMENTATIONS)}. {AGAIN}"
        )
    data = _bytes(file, path)
    if not stl.is_binary(data[: stl.HEAD], len(data)):
        data = without_mark(data)
    other = _content_of(data)
    try:
        mesh = READERS[ending](data)
        del data
        triangles, more = triangulate(mesh)
    except PolygonError as error:
        raise SettingError(f"setting 'surface': {path}: {error}") from None
    except ValueError as error:
        if other not in ("", ending):
            raise SettingError(
                f"setting 'surface': {path} is no {ending} file: its content is that of a {other} file. "
                + (f"Rename it to {file.stem}{other}" if other in FORMATS else AGAIN)
            ) from None
        raise SettingError(f"setting 'surface': {path} is not a readable {ending} file: {error}. {AGAIN}") from None
    if not len(triangles):
        raise SettingError(f"setting 'surface': {path} contains no triangles. {AGAIN}")
    return mesh.vertices, triangles, mesh.notes + more, mesh.cut


def _bytes(file: Path, path: str) -> bytes:
    """The content of a regular file that is not too large."""
    try:
        size = check_file(file, LARGEST_FILE)
        if not size:
            raise SettingError(f"setting 'surface': {path} contains no triangles: it has 0 bytes. {AGAIN}")
        return file.read_bytes()
    except FileNotFoundError:
        raise SettingError(f"setting 'surface': no file {path} (looked in {Path.cwd()})") from None
    except IsADirectoryError:
        raise SettingError(
            f"setting 'surface': {path} is a folder, expected a mesh file (looked in {Path.cwd()})"
        ) from None
    except OSError as error:
        if file.is_file() and (size := file.stat().st_size) > LARGEST_FILE:
            raise SettingError(
                f"setting 'surface': {path} has {size / 1e6:.0f} MB, expected at most {LARGEST_FILE / 1e6:.0f} MB. Give"
                " it fewer triangles."
            ) from None
        raise SettingError(f"setting 'surface': {path}: {error.strerror}") from None


def _content_of(data: bytes) -> str:
    """The format that the first bytes of a file show, as an ending; "": none of the known."""
    if stl.is_binary(data[: stl.HEAD], len(data)):
        return ".stl"
    head = data[: stl.HEAD].lstrip()
    return next((ending for start, ending in STARTS if head.startswith(start)), "")
