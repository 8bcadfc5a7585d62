"""Foot point, normal and signed distance at a point of a triangle mesh.

The pseudonormal of a face, edge or vertex gives the correct sign everywhere round a closed mesh, unlike the normal of
the nearest face: J. A. Baerentzen, H. Aanaes, IEEE Trans. Vis. Comput. Graph. 11 (2005) 243-253.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import put, vector
from palpate.physics.arrays import Indices, Record
from palpate.physics.geometry.bvh import is_segment

FACE, VERTEX, EDGE = 0, 1, 4
"""Region of a point on a triangle: interior, corner 0-2 (VERTEX + i), edge from corner i (EDGE + i)."""


@kernel
def foot_of(points: Record, cells: Record, t: int, v: float, w: float, foot: Record):
    """Set the foot to the point with barycentric coordinates (1 - v - w, v, w) of triangle t."""
    i, j, k = vector(cells[t].corners)
    for c in range(3):
        a, b, d = points[i].position[c], points[j].position[c], points[k].position[c]
        foot.point[c] = a + v * (b - a) + w * (d - a)


@kernel
def face_normal(points: Record, cells: Record, t: int):
    """The normal [1] of a triangle; 0 of none and of one without area."""
    if t < 0 or cells[t].kind > 0:
        return 0.0, 0.0, 0.0
    i, j, k = vector(cells[t].corners)
    a, b, c = points[i].position, points[j].position, points[k].position
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@kernel
def normal_at(points: Record, cells: Record, t: int, v: float, w: float, foot: Record):
    """Set the foot's normal to the interpolated vertex normal; the face normal if it vanishes; (0, 0, 1) if both do."""
    u = 1.0 - v - w
    i, j, k = vector(cells[t].corners)
    a, b, c = points[i].normal, points[j].normal, points[k].normal
    x = u * a[0] + v * b[0] + w * c[0]
    y = u * a[1] + v * b[1] + w * c[1]
    z = u * a[2] + v * b[2] + w * c[2]
    length = np.sqrt(x * x + y * y + z * z)
    if length < 1e-6:
        x, y, z = face_normal(points, cells, t)
        length = np.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            x, y, z, length = 0.0, 0.0, 1.0, 1.0
    put(foot.normal, (x / length, y / length, z / length))


@kernel
def signed_distance(
    points: Record,
    cells: Record,
    star_at: Indices,
    star: Indices,
    t: int,
    v: float,
    w: float,
    place: int,
    p0: float,
    p1: float,
    p2: float,
    foot: Record,
):
    """Signed distance of p from its nearest point, to which the foot is set.

    The sign is that of (p - foot).n with the pseudonormal n: of the face, the sum over both faces of an edge, or the
    angle-weighted sum over those of a vertex. At a border the result is (p - foot).n itself, as if the sheet continued
    flat beyond it, so that the distance is continuous round the border.
    """
    foot_of(points, cells, t, v, w, foot)
    r0, r1, r2 = p0 - foot.point[0], p1 - foot.point[1], p2 - foot.point[2]
    border = False
    if place == FACE:
        x, y, z = face_normal(points, cells, t)
    elif place >= EDGE:
        i = place - EDGE
        other = cells[t].across[i]
        border = other < 0
        x, y, z = face_normal(points, cells, t)
        for s in _beyond(cells, t, other):
            a, b, c = face_normal(points, cells, s)
            x, y, z = x + a, y + b, z + c
    else:
        a = cells[t].corners[place - VERTEX]
        x, y, z = vector(points[a].normal)
        for k in range(star_at[a], star_at[a + 1]):
            cell = cells[star[k]]
            for i in range(3):
                if is_segment(cell.corners):
                    break
                if (cell.corners[i] == a or cell.corners[(i + 1) % 3] == a) and cell.across[i] < 0:
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
def _beyond(cells: Record, t: int, other: int):
    """The triangles across an edge: the neighbour or, if it is degenerate, those on its other edges."""
    if other < 0 or cells[other].kind == 0:
        return other, -1, -1
    a, b, c = vector(cells[other].across)
    return (-1 if a == t else a), (-1 if b == t else b), (-1 if c == t else c)
