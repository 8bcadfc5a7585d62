"""Repairs a mesh file: closes holes, orients triangles outwards, removes self-intersections."""

from pathlib import Path

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from palpate.models.build.parted import part_solids
from palpate.nodes.base.mesh_file import flaws, read_triangles
from palpate.physics.errors import MeshError
from palpate.physics.geometry.crossing import UncheckedError, crossing
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.physics.geometry.topology import edge_counts, outward
from palpate.units.header import factor

TOUCHING = "solids that touch along an edge parted"


def repair_mesh(file: Path, unit: str, piece: int = 0) -> tuple[Path, list[str]]:
    """Write a closed mesh in metres next to the file; returns it and a line per repair, or the file if it is sound.

    Holes are closed by fans. Solids that touch along an edge are parted there (`parted`). If triangles intersect, or
    more than two share an edge otherwise, fTetWild rebuilds the surface within 0.1 % of its size.

    unit   of the file: m, cm or mm
    piece  as of `read_triangles`

    MeshError: it cannot be repaired, or fTetWild is not installed. SettingError: the file cannot be read.
    """
    vertices, triangles = read_triangles(str(file), piece)
    border, shared = edge_counts(triangles, len(vertices))
    if not (border or shared or flaws(str(file), piece)):
        return file, []
    done = []
    if shared and (apart := part_solids(vertices, triangles)) is not None:
        vertices, triangles = apart
        border, shared = edge_counts(triangles, len(vertices))
        done.append(TOUCHING)
    if not shared:
        triangles = outward(vertices, triangles)
        if border:
            vertices, triangles, holes = _close_borders(vertices, triangles)
            done.append(f"{holes} hole{'s' * (holes > 1)} closed by fans")
            triangles = outward(vertices, triangles)
            shared = edge_counts(triangles, len(vertices))[1]
    if shared or _crosses(vertices, triangles):
        from palpate.models.fe.meshing.organ import solid  # its package is an extra

        surface = solid(Mesh(vertices, triangles))[1]
        vertices, triangles = surface.vertices, surface.triangles
        done.append("surface rebuilt without self-intersections")
    border, shared = edge_counts(triangles, len(vertices))
    if shared and (apart := part_solids(vertices, triangles)) is not None:
        vertices, triangles = apart
        border, shared = edge_counts(triangles, len(vertices))
        done.append(TOUCHING)
    if border or shared:
        raise MeshError(
            f"--repair: {file} still has {border} open edges and {shared} of more than two triangles. Repair it "
            "in a mesh editor"
        )
    out = file.with_name(f"{file.stem}-repaired.ply")
    try:
        write_ply(out, Mesh(vertices * factor(unit, "m"), outward(vertices, triangles)))
    except OSError as error:
        raise MeshError(f"--repair: {out} cannot be written: {error.strerror}") from None
    return out, done or ["triangles turned outwards"]


def _crosses(vertices: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether the surface intersects itself, also if not all pairs of triangles could be tested."""
    try:
        return crossing(vertices, triangles) is not None
    except UncheckedError:
        return True


def _close_borders(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The mesh with each border closed by triangles to its mean point, and the number of borders."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    key = np.sort(sides, axis=1) @ (len(vertices), 1)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    border = sides[first[count == 1]]
    rim, ends = np.unique(border, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(rim), len(rim)))
    holes, hole = connected_components(graph, directed=False)
    middle = np.stack([np.bincount(hole, vertices[rim, i]) for i in range(3)], axis=1) / np.bincount(hole)[:, None]
    fan = np.column_stack([border[:, ::-1], len(vertices) + hole[ends[:, 0]]]).astype(np.int32)
    return np.concatenate([vertices, middle]), np.concatenate([triangles, fan]), holes
