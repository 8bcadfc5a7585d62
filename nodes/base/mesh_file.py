"""Reading a user's triangle mesh: STL (binary or text), PLY, OBJ."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from palpate.nodes.base import SettingError
from palpate.physics.geometry.bvh import weld
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.orient import edge_counts, outward

LEAST_AREA = 1e-9
"""[1] Of all triangles, over the square of the longest side."""
FORMATS = (".stl", ".ply", ".obj")
SMALLEST, LARGEST = 2e-3, 1.0
"""[m] Limits of the longest side of what a fingertip may touch: beyond them the unit is wrong."""


def read_mesh(path: str, scale: float) -> Mesh:
    """The mesh of a file, its numbers times `scale` [m].

    Equal vertices are made one (an STL file repeats them), triangles without three corners, repeated triangles and
    vertices that no triangle holds are left out, and the triangles are turned one way round: a closed mesh outwards, an
    open one as most of its triangles are.

    SettingError: no such file, not a mesh, no triangles, no area, an implausible size, edges of more than two
    triangles.
    """
    vertices, triangles = _load(path)
    if not len(triangles):
        raise SettingError(f"setting 'surface': {path} holds no triangles")
    if not np.isfinite(vertices).all():
        raise SettingError(f"setting 'surface': {path} holds a vertex that is not a finite number")
    if not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise SettingError(
            f"setting 'surface': {path}: a triangle has the corner {triangles.max()}, the file holds {len(vertices)} "
            "vertices: it is damaged"
        )
    vertices = vertices * scale
    triangles = _distinct(weld(vertices)[triangles])
    if not len(triangles):
        raise SettingError(f"setting 'surface': {path}: every triangle is a point or a line")
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], triangles.reshape(-1, 3).astype(np.int32)
    _plausible(path, vertices)
    if not _area(vertices, triangles) > LEAST_AREA * float(np.ptp(vertices, axis=0).max()) ** 2:
        raise SettingError(
            f"setting 'surface': {path} has no area: its {len(triangles)} triangles are lines. Expected a surface; it "
            "may have lost a coordinate when it was written."
        )
    _, shared = edge_counts(triangles, len(vertices))
    if shared:
        raise SettingError(
            f"setting 'surface': {path} has {shared} edges that more than two triangles share: it has no inside. "
            "Repair it in a mesh editor (remove inner faces, make it manifold)."
        )
    return Mesh(vertices, outward(vertices, triangles))


def _load(path: str) -> tuple[np.ndarray, np.ndarray]:
    file = Path(path).expanduser()
    if file.suffix.lower() not in FORMATS:
        raise SettingError(f"setting 'surface': {path}: format {file.suffix!r}, expected one of {', '.join(FORMATS)}")
    if not file.is_file():
        raise SettingError(f"setting 'surface': no file {path} (looked in {Path.cwd()})")
    try:
        import trimesh
    except ImportError:
        raise SettingError("mesh files need the package trimesh: pip install 'palpate[mesh]'") from None
    try:
        mesh: Any = trimesh.load(file, force="mesh", process=False)
        return np.array(mesh.vertices, dtype=float).reshape(-1, 3), np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # the reader raises whatever the broken bytes lead it to
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SettingError(f"setting 'surface': {path} is not a {file.suffix[1:]} mesh: {text}") from None


def _area(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _distinct(triangles: np.ndarray) -> np.ndarray:
    """Triangles of three different corners, none twice."""
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return triangles[np.sort(first)]


def _plausible(path: str, vertices: np.ndarray) -> None:
    longest = float(np.ptp(vertices, axis=0).max())
    if not SMALLEST <= longest <= LARGEST:
        raise SettingError(
            f"setting 'file_unit': {path} is {longest:.3g} m across, expected {SMALLEST} to {LARGEST} m. "
            "Mesh files are usually in millimetres: file_unit: mm."
        )
