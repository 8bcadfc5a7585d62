"""Foot point, normal and signed distance at a point of a triangle mesh.

The pseudonormal of a face, edge or vertex gives the correct sign everywhere round a closed mesh, unlike the normal of
the nearest face: J. A. Baerentzen, H. Aanaes, IEEE Trans. Vis. Comput. Graph. 11 (2005) 243-253.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix
from palpate.physics.geometry.bvh import ACROSS, KIND, is_segment

FACE, VERTEX, EDGE = 0, 1, 4
"""Region of a point on a triangle: interior, corner 0-2 (VERTEX + i), edge from corner i (EDGE + i)."""


@kernel
def foot_of(points: Matrix, cells: Indices, t: int, v: float, w: float, foot: Array):
    """The point with barycentric coordinates (1 - v - w, v, w) of triangle t of cells (T,3), into foot [m] (3)."""
    for c in range(3):
        a, b, d = points[cells[t, 0], c], points[cells[t, 1], c], points[cells[t, 2], c]
        foot[c] = a + v * (b - a) + w * (d - a)


@kernel
def face_normal(points: Matrix, cells: Indices, t: int):
    """The normal [1] of a triangle; 0 of none and of one without area."""
    if t < 0 or cells[t, KIND] > 0:
        return 0.0, 0.0, 0.0
    i, j, k = cells[t, 0], cells[t, 1], cells[t, 2]
    ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    vx, vy, vz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@kernel
def normal_at(points: Matrix, cells: Indices, t: int, v: float, w: float, foot: Array):
    """The interpolated vertex normal into foot[3:6]; the face normal if it vanishes; (0, 0, 1) if both do."""
    u = 1.0 - v - w
    i, j, k = cells[t, 0], cells[t, 1], cells[t, 2]
    x = u * points[i, 3] + v * points[j, 3] + w * points[k, 3]
    y = u * points[i, 4] + v * points[j, 4] + w * points[k, 4]
    z = u * points[i, 5] + v * points[j, 5] + w * points[k, 5]
    length = np.sqrt(x * x + y * y + z * z)
    if length < 1e-6:
        x, y, z = face_normal(points, cells, t)
        length = np.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            x, y, z, length = 0.0, 0.0, 1.0, 1.0
    foot[3], foot[4], foot[5] = x / length, y / length, z / length


@kernel
def signed_distance(
    points: Matrix,
    cells: Indices,
    star_at: Indices,
    star: Indices,
    t: int,
    v: float,
    w: float,
    place: int,
    p0: float,
    p1: float,
    p2: float,
    foot: Array,
):
    """Signed distance of p from its nearest point, and that point into foot[:3].

    The sign is that of (p - foot).n with the pseudonormal n: of the face, the sum over both faces of an edge, or the
    angle-weighted sum over those of a vertex. At a border the result is (p - foot).n itself, as if the sheet continued
    flat beyond it, so that the distance is continuous round the border.
    """
    foot_of(points, cells, t, v, w, foot)
    r0, r1, r2 = p0 - foot[0], p1 - foot[1], p2 - foot[2]
    border = False
    if place == FACE:
        x, y, z = face_normal(points, cells, t)
    elif place >= EDGE:
        i = place - EDGE
        other = cells[t, ACROSS + i]
        border = other < 0
        x, y, z = face_normal(points, cells, t)
        for s in _beyond(cells, t, other):
            a, b, c = face_normal(points, cells, s)
            x, y, z = x + a, y + b, z + c
    else:
        a = cells[t, place - VERTEX]
        x, y, z = points[a, 3], points[a, 4], points[a, 5]
        for k in range(star_at[a], star_at[a + 1]):
            s = star[k]
            for i in range(3):
                if is_segment(cells, s):
                    break
                if (cells[s, i] == a or cells[s, (i + 1) % 3] == a) and cells[s, ACROSS + i] < 0:
                    border = True
    length = np.sqrt(x * x + y * y + z * z)
    along = r0 * x + r1 * y + r2 * z
    distance = np.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
    if length < 1e-12:
        return distance
    if border:
        return along / length
    return distance if along >= 0.0 else -distance


@kernel
def _beyond(cells: Indices, t: int, other: int):
    """The triangles across an edge: the neighbour or, if it is degenerate, those on its other edges."""
    if other < 0 or cells[other, KIND] == 0:
        return other, -1, -1
    a, b, c = cells[other, ACROSS], cells[other, ACROSS + 1], cells[other, ACROSS + 2]
    return (-1 if a == t else a), (-1 if b == t else b), (-1 if c == t else c)
