"""Self-intersection of a triangle mesh."""

import numpy as np

from palpate.physics.kernel import kernel


def crossing(points: np.ndarray, triangles: np.ndarray) -> tuple[int, int, np.ndarray] | None:
    """Two triangles of which one has an edge through the interior of the other, and where [m] (3,); None: not found.

    Triangles that only touch, are coplanar or share a corner do not cross.
    """
    points, triangles = np.array(points, dtype=np.float64), np.ascontiguousarray(triangles, dtype=np.int64)
    middle = points[triangles].mean(axis=(0, 1))
    points -= middle  # far from the origin, rounding of the coordinates would exceed the tolerance of `_side`
    corner = points[triangles]
    order = np.argsort(corner[:, :, 0].min(axis=1))
    low, high = corner[order].min(axis=1), corner[order].max(axis=1)
    at = np.zeros(3)
    first, other = _crossing(points, triangles[order], low, high, float((high - low)[:, 0].max()), at)
    return None if first < 0 else (int(order[first]), int(order[other]), at + middle)


@kernel
def _side(a, b, c, p):
    """Six times the volume of the tetrahedron a, b, c, p, or 0 if rounding may have changed its sign: the filter of
    J. R. Shewchuk, Discrete Comput. Geom. 18 (1997) 305, with a larger tolerance because the vertices are rounded."""
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    w0, w1, w2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    volume = (u1 * v2 - u2 * v1) * w0 + (u2 * v0 - u0 * v2) * w1 + (u0 * v1 - u1 * v0) * w2
    terms = (
        (abs(u1 * v2) + abs(u2 * v1)) * abs(w0)
        + (abs(u2 * v0) + abs(u0 * v2)) * abs(w1)
        + (abs(u0 * v1) + abs(u1 * v0)) * abs(w2)
    )
    return volume if abs(volume) > 1e-12 * terms else 0.0


@kernel
def _crossing(points, triangles, low, high, widest, at):
    """The first pair, or -1, -1. Triangles are sorted by their smallest x; low, high (T,3): bounds; at: the place."""
    for i in range(len(triangles)):
        first = np.searchsorted(low[:, 0], low[i, 0] - widest)
        for j in range(first, len(triangles)):
            if low[j, 0] > high[i, 0]:
                break
            if i == j or high[j, 0] < low[i, 0]:
                continue
            if high[j, 1] < low[i, 1] or low[j, 1] > high[i, 1] or high[j, 2] < low[i, 2] or low[j, 2] > high[i, 2]:
                continue
            a, b, c = points[triangles[j, 0]], points[triangles[j, 1]], points[triangles[j, 2]]
            for k in range(3):  # edges of i through the inside of j
                m, n = triangles[i, k], triangles[i, (k + 1) % 3]
                shared = False
                for l in range(3):
                    if triangles[j, l] == m or triangles[j, l] == n:
                        shared = True
                if shared:
                    continue
                p, q = points[m], points[n]
                above, below = _side(a, b, c, p), _side(a, b, c, q)
                if not above * below < 0.0:
                    continue
                x, y, z = _side(p, q, a, b), _side(p, q, b, c), _side(p, q, c, a)
                if (x > 0.0 and y > 0.0 and z > 0.0) or (x < 0.0 and y < 0.0 and z < 0.0):
                    share = above / (above - below)
                    for l in range(3):
                        at[l] = p[l] + share * (q[l] - p[l])
                    return i, j
    return -1, -1
