"""Decimation of a mesh that is finer than loads and displacements require.

The remaining vertices are a Poisson-disk sample (R. L. Cook, ACM Trans. Graph. 5 (1986) 51-72): no two are closer than
h along the surface, and each removed one is within h of a remaining one. Each vertex belongs to the nearest remaining
one. The new mesh, the dual of the Voronoi diagram of the sample (G. Peyre, L. D. Cohen, Int. J. Comput. Vis. 69 (2006)
145-156), consists of the triangles whose corners belong to three different ones. Sums over its vertices with its nodal
areas integrate linear functions exactly, and functions over a patch of radius R to O(h²/R²), for any original density.

The normal of a remaining vertex is the mean over the vertices that belong to it, as normals of the new, irregular
triangles have errors up to 2 degrees. At a border the new mesh ends up to h inside the original one.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices, Matrix
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.search.corners import stars

REGION = 8.0  # [1] Side of the cells in which the density is measured, over h
FEWEST = 100  # Vertices in a cell below which its density is not significant
CROWDED = 3.0  # [1] Vertices over area/h² above which a mesh is decimated
LEAST = 1000  # Approximate lower limit of the number of remaining vertices


def thin_mesh(mesh: Mesh, spacing: float) -> Mesh:
    """The mesh with vertices at least `spacing` [m] apart, less if fewer than `LEAST` would remain; unchanged if no
    region has more than `CROWDED` times the vertices that this requires."""
    spacing = min(spacing, float(np.sqrt(mesh.areas.sum() / LEAST)))
    if not spacing > 0.0 or not _is_crowded(mesh, spacing):
        return mesh
    star_at, star = stars(mesh.triangles, len(mesh.vertices))
    owner = _owners(mesh.vertices, mesh.triangles, star_at, star, spacing)
    facing = np.stack([np.bincount(owner, mesh.areas * along) for along in mesh.normals.T], axis=1)
    corners = _image(owner[mesh.triangles])
    kept, triangles = np.unique(corners, return_inverse=True)
    facing = facing[kept] / np.maximum(np.linalg.norm(facing[kept], axis=1), 1e-300)[:, None]
    return Mesh(np.ascontiguousarray(mesh.vertices[kept]), triangles.reshape(-1, 3).astype(np.int32), facing)


def _image(corners: np.ndarray) -> np.ndarray:
    """The triangles (T,3) to which a surface is mapped, from the remaining vertices (n,3) to which the corners of its
    triangles belong: those that it covers more often in one direction than in the other.

    The difference of both counts is the image of the surface as a chain, whose border is the image of its border: a
    closed surface stays closed where a few vertices are cut off from the others with the same owner, so that triangles
    are covered twice, or back and forth.
    """
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    order = corners.argsort(axis=1)
    odd = (order[:, 1] - order[:, 0]) % 3 == 2
    found, which = np.unique(np.take_along_axis(corners, order, axis=1), axis=0, return_inverse=True)
    times = np.bincount(which.ravel(), np.where(odd, -1.0, 1.0), len(found))
    back = times < 0.0
    found[back] = found[back][:, [0, 2, 1]]
    return np.unique(found[times != 0.0], axis=0)


def _is_crowded(mesh: Mesh, spacing: float) -> bool:
    """Whether a region has more than `CROWDED` times the vertices that the spacing requires."""
    cell = ((mesh.vertices - mesh.vertices.min(axis=0)) / (REGION * spacing)).astype(np.int64)
    _, y, z = cell.max(axis=0) + 1
    where = (cell[:, 0] * y + cell[:, 1]) * z + cell[:, 2]
    count, area = np.bincount(where), np.bincount(where, mesh.areas)
    return bool(((count > FEWEST) & (count * spacing**2 > CROWDED * area)).any())


@kernel
def _owners(points: Matrix, triangles: Indices, star_at: Indices, star: Indices, spacing: float):
    """The sample vertex to which each vertex belongs (V,): the nearest, in a straight line, of those from which it is
    connected by edges within the spacing [m]. The sample is taken greedily in the order of the vertices."""
    size = len(points)
    owner, seen, queue = np.full(size, -1), np.full(size, -1), np.empty(size, np.int64)
    away = np.full(size, np.inf)
    for v in range(size):
        if owner[v] >= 0:
            continue
        owner[v] = seen[v] = queue[0] = v
        away[v] = 0.0
        head, tail = 0, 1
        while head < tail:
            a = queue[head]
            head += 1
            for at in range(3 * star_at[a], 3 * star_at[a + 1]):
                b = triangles[star[at // 3], at % 3]
                if seen[b] == v:
                    continue
                seen[b] = v
                square = 0.0
                for k in range(3):
                    square += (points[b, k] - points[v, k]) ** 2
                if square < spacing * spacing:
                    queue[tail] = b
                    tail += 1
                    if square < away[b]:
                        away[b], owner[b] = square, v
    return owner
