"""Reading a user's triangle mesh: STL (binary or text), PLY, OBJ."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # its parts are slow to import, and are when they are used

from palpate.nodes.base import SettingError
from palpate.physics.extras import missing
from palpate.physics.geometry.bvh import weld
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.topology import FLAT, crossing, edge_counts, outward

LEAST_AREA = 1e-9  # [1] of all triangles, over the square of the longest side
FORMATS = (".stl", ".ply", ".obj")
NEAR = 1e-6
"""[1] Of the longest side: vertices at open edges that are nearer are made one; the numbers of an STL file are rounded
to 6e-8 of themselves."""
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
SMALLEST, LARGEST = 2e-3, 1.0
"""[m] Limits of the longest side of what a fingertip may touch: beyond them the unit is wrong."""
LARGEST_FILE = 1 << 28  # [bytes] 5 million triangles of a binary STL: what is read takes ten times as much memory
MOST_CHECKED = 50_000  # triangles whose intersections are looked for, which takes 2 s
MEND = "`palpate run kidney --organ {} --repair`"


def read_mesh(path: str, scale: float) -> Mesh:
    """The mesh of a file, its numbers times `scale` [m].

    Equal vertices are made one (an STL file repeats them), and vertices at open edges nearer than `NEAR`.
    Triangles without three corners, repeated triangles and vertices that no triangle holds are left out. The triangles
    are turned outwards (`topology.outward`); those of an open sheet as most of them are.

    SettingError: no such file, not a mesh, no triangles, no area, an implausible size, edges of more than two
    triangles.
    """
    vertices, triangles = read_triangles(path)
    _plausible(path, vertices, scale)
    vertices = vertices * scale
    if not Mesh(vertices, triangles).areas.sum() > LEAST_AREA * float(np.ptp(vertices, axis=0).max()) ** 2:
        raise SettingError(
            f"setting 'surface': {path} has no area: its {len(triangles)} triangles are lines. Expected a surface; it "
            "may have lost a coordinate when it was written."
        )
    _, shared = edge_counts(triangles, len(vertices))
    if shared:
        raise SettingError(
            f"setting 'surface': {path} has {shared} edges that more than two triangles share: it has no inside. "
            f"{MEND.format(path)} makes a surface of it."
        )
    return Mesh(vertices, outward(vertices, triangles))


def read_triangles(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V,3) as the file's numbers and triangles (T,3) int32: equal vertices made one, and those at open edges
    that are nearer than `NEAR`; triangles without three corners, repeated triangles and vertices that no triangle holds
    left out, the order of corners as it was. SettingError: no such file, not a mesh, no triangles."""
    return _read(path)[:2]


def _read(path: str) -> tuple[np.ndarray, np.ndarray, int]:
    """`read_triangles`, and how many vertices were merged with one that is not equal."""
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
    triangles = _distinct(weld(vertices)[triangles])
    if not len(triangles):
        raise SettingError(f"setting 'surface': {path}: every triangle is a point or a line")
    same = _near(vertices, triangles)
    merged = int((same != np.arange(len(vertices))).sum())
    if merged:
        triangles = _distinct(same[triangles])
    used, triangles = np.unique(triangles, return_inverse=True)
    return vertices[used], triangles.reshape(-1, 3).astype(np.int32), merged


def _near(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """For each vertex the index of one that stands for all at an open edge that are nearer than `NEAR` (V,)."""
    ends, count = Mesh(vertices, triangles).edges
    border = np.unique(ends[count == 1])
    same = np.arange(len(vertices))
    if len(border):
        size = float(np.ptp(vertices[np.unique(triangles)], axis=0).max())
        pairs = scipy.spatial.cKDTree(vertices[border]).query_pairs(NEAR * size, output_type="ndarray")
        links = scipy.sparse.csr_array((np.ones(len(pairs)), pairs.T), shape=(len(border), len(border)))
        _, group = scipy.sparse.csgraph.connected_components(links, directed=False)
        _, first = np.unique(group, return_index=True)
        same[border] = border[first[group]]
    return same


def flaws(path: str) -> list[str]:
    """What is wrong with a mesh file that can be used all the same, a line each: open, inside out, self-intersecting.
    SettingError: it cannot be read."""
    vertices, triangles, merged = _read(path)
    border, _ = edge_counts(triangles, len(vertices))
    lines = []
    if merged:
        lines.append(f"{path}: {merged} vertices at open edges are merged with one within "
                     f"{NEAR:g} of its longest side.")  # fmt: skip
    right = outward(vertices, triangles)
    if border:
        areas = Mesh(vertices, right).face_vectors
        x, y, z = areas.sum(axis=0) / np.linalg.norm(areas, axis=1).sum()
        sheet = f" It is a sheet that faces ({x:.2g}, {y:.2g}, {z:.2g}); touch it from there."
        lines.append(
            f"{path} is open: {border} edges have a triangle on one side only. A finger that goes beyond them meets "
            f"nothing, and deformation.ReducedFE needs a closed surface. {MEND.format(path)} closes it."
            + sheet
            * (math.hypot(x, y, z) > FLAT)
        )
    turned = int((_least_first(right) != _least_first(triangles)).any(axis=1).sum())
    if turned == len(triangles):
        lines.append(f"{path} is inside out: all of its {turned} triangles face inwards. They are turned for this run.")
    elif turned:
        lines.append(
            f"{path} is partly inside out: {turned} of its {len(triangles)} triangles face the other way than the rest."
            " They are turned for this run."
        )
    if len(triangles) > MOST_CHECKED:
        lines.append(
            f"{path} has {len(triangles)} triangles: above {MOST_CHECKED} it is not checked whether they intersect."
        )
    elif through := crossing(vertices, triangles):
        x, y, z = through[2]
        lines.append(
            f"{path} intersects itself, first seen at ({x:.4g}, {y:.4g}, {z:.4g}) in its own numbers. The finger may "
            f"rest on a part that lies inside. {MEND.format(path)} mends it."
        )
    return lines


def _load(path: str) -> tuple[np.ndarray, np.ndarray]:
    file = Path(path).expanduser()
    if file.suffix.lower() not in FORMATS:
        raise SettingError(f"setting 'surface': {path}: format {file.suffix!r}, expected one of {', '.join(FORMATS)}")
    if not file.is_file():
        raise SettingError(f"setting 'surface': no file {path} (looked in {Path.cwd()})")
    if (size := file.stat().st_size) > LARGEST_FILE:
        raise SettingError(
            f"setting 'surface': {path} has {size / 1e6:.0f} MB, expected at most {LARGEST_FILE / 1e6:.0f} MB. Give it"
            " fewer triangles."
        )
    try:
        import trimesh
    except ImportError as error:
        raise SettingError(missing(f"setting 'surface': {path}", error.name, "mesh")) from None
    try:
        mesh: Any = trimesh.load(file, force="mesh", process=False)
        return np.array(mesh.vertices, dtype=float).reshape(-1, 3), np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # the reader raises whatever the broken bytes lead it to
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SettingError(f"setting 'surface': {path} is not a {file.suffix[1:]} mesh: {text}") from None


def _least_first(triangles: np.ndarray) -> np.ndarray:
    """The same triangles, each from its least corner on, in the sense that it has."""
    start = triangles.argmin(axis=1)[:, None]
    return np.take_along_axis(triangles, (start + np.arange(3)) % 3, axis=1)


def _distinct(triangles: np.ndarray) -> np.ndarray:
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return triangles[np.sort(first)]


def plausible_units(across: float) -> list[str]:
    """Units in which so large a number can be the longest side of what a fingertip may touch."""
    return [unit for unit, scale in UNITS.items() if SMALLEST <= across * scale <= LARGEST]


def _plausible(path: str, vertices: np.ndarray, scale: float) -> None:
    across = float(np.ptp(vertices, axis=0).max())
    if not SMALLEST <= across * scale <= LARGEST:
        others = " or ".join(f"file_unit: {unit} ({across * UNITS[unit]:.3g} m)" for unit in plausible_units(across))
        raise SettingError(
            f"setting 'file_unit': {path} is {across * scale:.3g} m across, expected {SMALLEST:g} to {LARGEST:g} m. "
            + (f"Its numbers fit {others}." if others else "No unit fits its numbers.")
        )
