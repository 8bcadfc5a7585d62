"""The foot point along interpolated normals: smooth over the edges between triangles.

The nearest point of a finger inside a mesh hops over each convex edge, by about h d/R (edges of length h, depth d,
radius R). The point q whose interpolated normal N(q) passes through p moves continuously instead (Phong projection:
L. Kobbelt, J. Vorsatz, H.-P. Seidel, Computational Geometry 14, 1999, 5-24; D. Panozzo et al., ACM Trans. Graph. 32,
2013, 60):

    (p - q) x N(q) = 0,    q = a + v e_1 + w e_2,    N = N_a + v (N_b - N_a) + w (N_c - N_a).

Newton's method begins at the nearest point, and continues in the neighbour where it crosses an edge. Near a centre of
curvature (1 - d kappa = 0) the map is singular, and where normals turn by a large angle within a triangle, as at an
edge of the body, q is not unique. There the nearest point remains: with c the least determinant over that of constant
normals, and b the least cosine between the normals of two corners, the foot is moved by the share g(c) g(b) of the
way, g(x) = t² (3 - 2t) with t = (x - x_0)/(x_1 - x_0) in [0, 1].
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Record, Vector3
from palpate.physics.geometry.pseudonormal import face_normal, foot_of, normal_at

SINGULAR, REGULAR = 0.02, 0.06
"""[1] c_0 and c_1. At c_0 the nearest point would move 50 times as far as the tool; the foot moves by at most six times
(`geometry.proxy`)."""
BENT, EVEN = 0.92, 0.98
"""[1] b_0 and b_1: 23 and 11 degrees. Loaded meshes are refined until normals turn by 2 degrees along an edge."""
STEPS = 40  # of Newton's method and over edges
SETTLED = 1e-8  # [m] motion at which it ends


@kernel
def _newton_step(points: Record, cells: Record, t: int, v: float, w: float, p: Vector3):
    """Changes of v and w [1], the determinant over that of constant normals [1], and the least cosine between normals
    of corners [1]."""
    i, j, k = vector(cells[t].corners)
    at_a, at_b, at_c = points[i].position, points[j].position, points[k].position
    n_a, n_b, n_c = points[i].normal, points[j].normal, points[k].normal
    a11 = a12 = a22 = re1 = re2 = ne1 = ne2 = d11 = d12 = d21 = d22 = 0.0  # products of edges, r, N and its changes
    normal = face_normal(points, cells, t)
    rf = nf = g1 = g2 = ab = bc = ca = 0.0
    for c in range(3):
        a, f = at_a[c], normal[c]
        e1, e2 = at_b[c] - a, at_c[c] - a
        n1, n2 = n_b[c] - n_a[c], n_c[c] - n_a[c]
        r, n = p[c] - a - v * e1 - w * e2, n_a[c] + v * n1 + w * n2
        ab, ca = ab + n_a[c] * n_b[c], ca + n_a[c] * n_c[c]
        bc += n_b[c] * n_c[c]
        a11, a12, a22 = a11 + e1 * e1, a12 + e1 * e2, a22 + e2 * e2
        re1, re2, rf = re1 + r * e1, re2 + r * e2, rf + r * f
        ne1, ne2, nf = ne1 + n * e1, ne2 + n * e2, nf + n * f
        d11, d12, d21, d22 = d11 + n1 * e1, d12 + n2 * e1, d21 + n1 * e2, d22 + n2 * e2
        g1, g2 = g1 + n1 * f, g2 + n2 * f
    # F_i = (r.e_i)(N.f) - (r.f)(N.e_i), the part of r x N along the triangle, and its derivatives by v and w
    h1, h2 = re1 * nf - rf * ne1, re2 * nf - rf * ne2
    j11, j12 = -a11 * nf + re1 * g1 - rf * d11, -a12 * nf + re1 * g2 - rf * d12
    j21, j22 = -a12 * nf + re2 * g1 - rf * d21, -a22 * nf + re2 * g2 - rf * d22
    det, flat = j11 * j22 - j12 * j21, (a11 * a22 - a12 * a12) * nf * nf
    even = min(ab, bc, ca)
    if not det > SINGULAR * flat or not even > BENT:
        return 0.0, 0.0, 0.0, 0.0
    return (j12 * h2 - j22 * h1) / det, (j21 * h1 - j11 * h2) / det, det / flat, even


@kernel
def _neighbour(cells: Record, t: int, v: float, w: float):
    """The neighbour across the edge that a point outside a triangle has crossed most, and the weights v and w there of
    the nearest point of that edge; -1: none."""
    u, side = 1.0 - v - w, 2  # the edge opposite to b
    if u <= v and u <= w:
        side = 1
    elif w <= v:
        side = 0
    other = cells[t].across[side]
    if other < 0 or cells[other].kind > 0:
        return -1, v, w
    first, second = cells[t].corners[side], cells[t].corners[(side + 1) % 3]
    shares = (max(u, 0.0), max(v, 0.0), max(w, 0.0))
    x, y = shares[side], shares[(side + 1) % 3]
    x, y, v, w = x / (x + y), y / (x + y), 0.0, 0.0
    for corner in range(1, 3):
        a = cells[other].corners[corner]
        share = x if a == first else y if a == second else 0.0
        if corner == 1:
            v = share
        else:
            w = share
    return other, v, w


@kernel
def _share(x: float, low: float, high: float):
    """From 0 at `low` to 1 at `high`."""
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@kernel
def smooth_foot(points: Record, cells: Record, t: int, v: float, w: float, p: Vector3, foot: Record):
    """Set point and normal of the foot of p, from its nearest point (v, w) [1] on triangle t. Returns the triangle of
    the foot, and its weights."""
    foot_of(points, cells, t, v, w, foot)
    normal_at(points, cells, t, v, w, foot)
    if cells[t].kind > 0:
        return t, v, w
    first, x0, y0 = t, v, w
    nearest, facing = vector(foot.point), vector(foot.normal)
    least, even, settled = np.inf, 1.0, False
    for _ in range(STEPS):
        q0, q1, q2 = vector(foot.point)
        dv, dw, c, b = _newton_step(points, cells, t, v, w, p)
        least, even = min(least, c), min(even, b)
        if c == 0.0:
            break
        v, w = v + dv, w + dw
        if min(v, w, 1.0 - v - w) < 0.0:
            other, x, y = _neighbour(cells, t, v, w)
            if other < 0:  # a border
                v, w = min(max(v, 0.0), 1.0), min(max(w, 0.0), 1.0)
                v, w = v / max(v + w, 1.0), w / max(v + w, 1.0)
            else:
                t, v, w = other, x, y
        foot_of(points, cells, t, v, w, foot)
        if (foot.point[0] - q0) ** 2 + (foot.point[1] - q1) ** 2 + (foot.point[2] - q2) ** 2 < SETTLED * SETTLED:
            settled = True
            break
    normal_at(points, cells, t, v, w, foot)
    share = _share(least, SINGULAR, REGULAR) * _share(even, BENT, EVEN) if settled else 0.0
    if share < 1.0:
        size = 0.0
        for k in range(3):
            foot.point[k] = nearest[k] + share * (foot.point[k] - nearest[k])
            foot.normal[k] = facing[k] + share * (foot.normal[k] - facing[k])
            size += foot.normal[k] ** 2
        for k in range(3):
            foot.normal[k] /= np.sqrt(size)
    return (t, v, w) if share > 0.0 else (first, x0, y0)
