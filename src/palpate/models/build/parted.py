"""Parts solids that touch along edges, so that each edge has two triangles.

The faces of voxels, and a gap that narrows to nothing, leave edges with four or more triangles. Sorted by angle about
the edge, the solid lies between each triangle whose normal faces ahead and the one before it, whose normal faces back.
Both are divided at a new vertex in the middle of the edge, which is moved into the solid between them by `APART`, since
vertices at the same place would be merged when the file is read. So the solids touch at the ends of these edges only.
"""

import numpy as np

from palpate.physics.arrays import Array
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.geometry.refined.edges import directions, unit

APART = 1e-4  # [1] of the size of the mesh


def part_solids(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """The vertices (V,3) and triangles (T,3) with touching solids apart; None: an edge with more than two triangles has
    an odd number, or their normals do not alternate, so that there are no solids between them."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    if np.einsum("ij,ij->", np.cross(a, b), c) < 0.0:
        triangles = triangles[:, ::-1]  # inside out
    triangles = triangles.astype(np.int64)
    ends, of, _ = edges_of(triangles, len(vertices))
    order = np.argsort(of.ravel(), kind="stable")  # sides of triangles, 3 t + corner, by edge
    last = np.cumsum(np.bincount(of.ravel()))
    pairs = []
    for edge in np.flatnonzero(np.diff(last, prepend=0) > 2):
        found = _around(vertices, triangles, ends[edge], order[last[edge - 1] if edge else 0 : last[edge]])
        if found is None:
            return None
        pairs.append(found)
    both = np.concatenate(pairs)
    middle = np.full(triangles.size, -1)
    middle[both] = len(vertices) + np.arange(len(both))[:, None]
    out = unit(directions(vertices, triangles)[both // 3].sum(axis=1))
    moved = vertices[ends[of.ravel()[both[:, 0]]]].mean(axis=1) - APART * float(np.ptp(vertices, axis=0).max()) * out
    parted, _ = divide_triangles(triangles, middle.reshape(-1, 3))
    return np.concatenate([vertices, moved]), parted.astype(np.int32)


def _around(vertices: np.ndarray, triangles: np.ndarray, ends: Array, sides: Array) -> np.ndarray | None:
    """Pairs (n,2) of the sides (2 n) of triangles at an edge between two vertices, 3 t + corner, with the solid between
    them; None: not all have one."""
    of, corner = sides // 3, sides % 3
    along = vertices[ends[1]] - vertices[ends[0]]
    axis = along / max(float(np.linalg.norm(along)), 1e-300)
    away = vertices[triangles[of, (corner + 2) % 3]] - vertices[ends[0]]
    away = away - (away @ axis)[:, None] * axis
    order = np.argsort(np.arctan2(away @ np.cross(axis, away[0]), away @ away[0]))
    sides, ahead = sides[order], (triangles[of, corner] == ends[0])[order]
    if not (ahead != np.roll(ahead, 1)).all():
        return None
    return np.stack([sides[ahead], np.roll(sides, 1)[ahead]], axis=1)
