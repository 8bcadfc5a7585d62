"""Which triangles of a surface a ball can touch.

A ball of radius r touches the surface at x, with the outward normal n, if no other part of the body is within r of its
centre x + r n. The test at the middle of a triangle is enough where edges are short; larger triangles are divided.
"""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.compiler.fields import blank_record
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices, Matrix, Record
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import STACK, MeshClosestPoint, _disc, _on_triangle
from palpate.physics.geometry.pseudonormal import signed_distance
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.geometry.search.foot import FOOT

SLACK = 20e-6
"""[m] By which another part may be inside the ball: facets of 1.6 mm on a concave surface just wider than the ball are
16 um nearer than the surface that they approximate."""
LEVEL = 1e-12  # [m] over the tangent plane up to which a part is below it, for rounding
SHORT = 1 / 3  # [1] of the radius: longest edge of a triangle whose middle represents it


def divide_long_edges(mesh: Mesh, longest: float) -> tuple[Mesh, np.ndarray]:
    """The same flat triangles with edges of at most `longest` [m], and for each the triangle of `mesh` (T,)."""
    points, triangles, origin = mesh.vertices, mesh.triangles.astype(np.int64), np.arange(len(mesh.triangles))
    while True:
        ends, of, _ = edges_of(triangles, len(points))
        long = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1) > longest
        if not long.any():
            return Mesh(points, np.ascontiguousarray(triangles, np.int32)), origin
        number = np.full(len(ends), -1)
        number[long] = len(points) + np.arange(long.sum())
        points = np.concatenate([points, 0.5 * (points[ends[long, 0]] + points[ends[long, 1]])])
        triangles, part = divide_triangles(triangles, number[of])
        origin = origin[part]


def untouchable(mesh: Mesh, closest: MeshClosestPoint, radius: float) -> np.ndarray:
    """Whether no ball of the radius [m] touches the middle of each triangle (T,) of a mesh with edges of at most
    `SHORT` of the radius; `closest` finds the nearest points of the whole body."""
    length = np.linalg.norm(mesh.face_vectors, axis=1)
    normal = mesh.face_vectors / np.where(length > 0.0, length, 1.0)[:, None]
    middle = einsum("tkc,k->tc", mesh.vertices[mesh.triangles], np.full(3, 1.0 / 3.0))
    hidden = np.zeros(len(mesh.triangles), bool)
    closed = closest.mesh.closed  # a sheet has no inside
    _fill(*closest.tables.arrays, middle, normal, radius, closed, np.empty(STACK, np.int64), blank_record(FOOT), hidden)
    return hidden & (length > 0.0)


@kernel
def _fill(
    points: Record, cells: Record, discs: Record, star_at: Indices, star: Indices, middle: Matrix, normal: Matrix,
    radius: float, closed: bool, work: Indices, foot: Record, hidden: Indices,
):  # fmt: skip
    for t in range(len(middle)):
        m0, m1, m2 = middle[t]
        n0, n1, n2 = normal[t]
        p0, p1, p2 = m0 + radius * n0, m1 + radius * n1, m2 + radius * n2
        best, least = _in_front(points, cells, discs, p0, p1, p2, n0, n1, n2, radius, work)
        if best >= 0:
            hidden[t] = least < (radius - SLACK) ** 2
            if closed and not hidden[t]:
                _, v, w, place = _on_triangle(points, cells, best, p0, p1, p2)
                hidden[t] = signed_distance(points, cells, star_at, star, best, v, w, place, p0, p1, p2, foot) < 0.0


@kernel
def _in_front(
    points: Record, cells: Record, discs: Record, p0: float, p1: float, p2: float, n0: float, n1: float, n2: float,
    radius: float, work: Indices,
):  # fmt: skip
    """A triangle in the ball of the radius [m] about p, on its side of the tangent plane below it, and its squared
    distance [m²]; -1: none. The nearest one, or any that is nearer than `SLACK` allows.

    n [1]  normal of the tangent plane, which is at p - radius n

    All that is below the plane is outside the ball: on a smooth surface that is all of the neighbourhood.
    """
    count, leaves = len(cells), len(discs) // 2
    best, least, enough = -1, radius * radius, (radius - SLACK) ** 2
    depth = work[0] = 1
    while depth > 0:
        depth -= 1
        node = work[depth]
        disc = discs[node]
        along = (p0 - disc.centre[0]) * n0 + (p1 - disc.centre[1]) * n1 + (p2 - disc.centre[2]) * n2
        cosine = abs(disc.axis[0] * n0 + disc.axis[1] * n1 + disc.axis[2] * n2)
        reach = disc.radius * np.sqrt(max(1.0 - cosine * cosine, 0.0)) + disc.height * cosine
        if along - reach >= radius - LEVEL or _disc(disc, p0, p1, p2) >= least:
            continue
        if node < leaves:
            left, right = _disc(discs[2 * node], p0, p1, p2), _disc(discs[2 * node + 1], p0, p1, p2)
            near = 2 * node if left <= right else 2 * node + 1
            work[depth], work[depth + 1] = 4 * node + 1 - near, near
            depth += 2
            continue
        leaf = node - leaves
        for t in range(leaf * count // leaves, (leaf + 1) * count // leaves):
            low = np.inf
            for i in range(3):
                at = points[cells[t].corners[i]].position
                low = min(low, (p0 - at[0]) * n0 + (p1 - at[1]) * n1 + (p2 - at[2]) * n2)
            if low < radius - LEVEL:
                square, _, _, _ = _on_triangle(points, cells, t, p0, p1, p2)
                if square < least:
                    best, least = t, square
                if least < enough:
                    return best, least
    return best, least
