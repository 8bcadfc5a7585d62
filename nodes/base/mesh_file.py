"""Reading a user's triangle mesh: STL (binary or text), PLY, OBJ."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # imports its slow submodules at their first use

from palpate.nodes.base import SettingError
from palpate.physics.extras import missing
from palpate.physics.geometry.bvh import weld
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.topology import FLAT, crossing, edge_counts, outward

LEAST_AREA = 1e-9  # [1] least total area over the square of the longest side
FORMATS = (".stl", ".ply", ".obj")
NEAR = 1e-6
"""[1] Distance over the longest side within which vertices at open edges are merged; STL rounds numbers to 6e-8."""
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
SMALLEST, LARGEST = 2e-3, 1.0
"""[m] Limits of the longest side of a touched object; outside them the unit is assumed to be wrong."""
LARGEST_FILE = 1 << 28  # [bytes] 5 million triangles of a binary STL; reading takes ten times as much memory
MOST_CHECKED = 50_000  # number of triangles up to which intersections are searched, which takes 2 s
REPAIR = "`palpate run kidney --organ {} --repair`"


def read_mesh(path: str, scale: float) -> Mesh:
    """The mesh of a file; `scale`: its unit [m].

    Equal vertices (an STL file repeats them) and vertices at open edges nearer than `NEAR` are merged. Degenerate and
    repeated triangles and unused vertices are removed. Triangles are oriented outwards (`topology.outward`); those of
    an open sheet like most of them.

    SettingError: the file is missing or not a mesh, no triangles, no area, an implausible size, edges of more than two
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
            f"{REPAIR.format(path)} rebuilds its surface."
        )
    return Mesh(vertices, outward(vertices, triangles))


def read_triangles(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V,3) in the file's unit and triangles (T,3) int32, merged and cleaned as in `read_mesh`.

    The orientation of triangles is that of the file. SettingError: the file is missing or not a mesh, no triangles.
    """
    return _read(path)[:2]


def _read(path: str) -> tuple[np.ndarray, np.ndarray, int]:
    """As `read_triangles`, with the number of merged vertices that were not equal."""
    vertices, triangles = _load(path)
    if not len(triangles):
        raise SettingError(f"setting 'surface': {path} contains no triangles")
    if not np.isfinite(vertices).all():
        raise SettingError(f"setting 'surface': {path} contains a vertex that is not a finite number")
    if not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise SettingError(
            f"setting 'surface': {path}: a triangle has the corner {triangles.max()}, the file has {len(vertices)} "
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
    """Index (V,) of the vertex with which each is merged: the first of those at open edges nearer than `NEAR`."""
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
    """Flaws of a mesh file that can still be used, one line each: open, inside out, self-intersecting.

    SettingError: it cannot be read.
    """
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
        faces = f" It is a sheet that faces ({x:.2g}, {y:.2g}, {z:.2g}); touch it from there."
        lines.append(
            f"{path} is open: {border} edges have a triangle on one side only. A finger that goes beyond them meets "
            f"nothing, and deformation.ReducedFE needs a closed surface. {REPAIR.format(path)} closes it."
            + (faces if math.hypot(x, y, z) > FLAT else "")
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
            f"{path} intersects itself, first seen at ({x:.4g}, {y:.4g}, {z:.4g}) in the file's unit. The finger may "
            f"rest on a part that is inside. {REPAIR.format(path)} repairs it."
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
    except Exception as error:  # the reader may raise any exception for a damaged file
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SettingError(f"setting 'surface': {path} is not a {file.suffix[1:]} mesh: {text}") from None


def _least_first(triangles: np.ndarray) -> np.ndarray:
    """The triangles, rotated so that each begins with its least corner; the orientation is kept."""
    start = triangles.argmin(axis=1)[:, None]
    return np.take_along_axis(triangles, (start + np.arange(3)) % 3, axis=1)


def _distinct(triangles: np.ndarray) -> np.ndarray:
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return triangles[np.sort(first)]


def plausible_units(across: float) -> list[str]:
    """Units in which this number is a plausible longest side of a touched object."""
    return [unit for unit, scale in UNITS.items() if SMALLEST <= across * scale <= LARGEST]


def _plausible(path: str, vertices: np.ndarray, scale: float) -> None:
    across = float(np.ptp(vertices, axis=0).max())
    if not SMALLEST <= across * scale <= LARGEST:
        others = " or ".join(f"file_unit: {unit} ({across * UNITS[unit]:.3g} m)" for unit in plausible_units(across))
        raise SettingError(
            f"setting 'file_unit': {path} is {across * scale:.3g} m across, expected {SMALLEST:g} to {LARGEST:g} m. "
            + (f"Its numbers fit {others}." if others else "No unit fits its numbers.")
        )
