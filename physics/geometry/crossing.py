"""Where a triangle mesh passes through itself."""

from __future__ import annotations

import numpy as np

from palpate.physics.kernel import kernel


def crossing(points: np.ndarray, triangles: np.ndarray) -> tuple[int, int, np.ndarray] | None:
    """Two triangles of which one has an edge that passes through the other, and where [m] (3,); None: there are none.

    Triangles that only touch, or share a corner, do not cross.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    triangles = np.ascontiguousarray(triangles, dtype=np.int64)
    corner = points[triangles]
    order = np.argsort(corner[:, :, 0].min(axis=1))
    low, high = corner[order].min(axis=1), corner[order].max(axis=1)
    at = np.zeros(3)
    first, other = _crossing(points, triangles[order], low, high, float((high - low)[:, 0].max()), at)
    return None if first < 0 else (int(order[first]), int(order[other]), at)


@kernel
def _side(a, b, c, p):
    """Six times the volume of the tetrahedron a, b, c, p."""
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    w0, w1, w2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    return (u1 * v2 - u2 * v1) * w0 + (u2 * v0 - u0 * v2) * w1 + (u0 * v1 - u1 * v0) * w2


@kernel
def _crossing(points, triangles, low, high, widest, at):
    """Triangles are in the order of their least x, low and high (T,3) their bounds; the first pair, or -1, -1."""
    tiny = 1e-12
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
                size = tiny * (abs(x) + abs(y) + abs(z))
                if (x > size and y > size and z > size) or (x < -size and y < -size and z < -size):
                    share = above / (above - below)
                    for l in range(3):
                        at[l] = p[l] + share * (q[l] - p[l])
                    return i, j
    return -1, -1
