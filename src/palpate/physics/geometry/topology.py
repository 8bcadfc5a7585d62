"""Topology of a triangle mesh: borders, non-manifold edges, consistent orientation, self-intersection."""

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.kernel import kernel
from palpate.physics.geometry.pieces import parents


def edge_counts(triangles: np.ndarray, vertices: int) -> tuple[int, int]:
    """Number of border edges, with one triangle (0: closed), and of non-manifold edges, with more than two."""
    ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    _, count = np.unique(ends[:, 0] * vertices + ends[:, 1], return_counts=True)
    return int((count == 1).sum()), int((count > 2).sum())


FLAT = 0.75
"""[1] Length of the sum of the area vectors over the area, above which an open piece is a sheet: 0.5 for a hemisphere,
0.71 for half a kidney, 1 for a plane. Below it the piece is treated as a body with a hole."""


def outward(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles of a manifold mesh, each connected piece oriented consistently, bodies with positive volume.

    vertices [m] (V,3), triangles (T,3). A closed piece that no other encloses gets positive volume. One that another
    encloses keeps the orientation relative to that which most of its triangles have, so that a cavity remains a cavity.
    An open piece gets positive volume about the mean of its border, as if its hole were closed. A sheet (`FLAT`) has no
    inside and gets the orientation of most of its triangles.
    """
    triangles = np.asarray(triangles, dtype=np.int32)
    # each edge of a triangle, with its twin in the neighbour
    begin, end = triangles.ravel().astype(np.int64), np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(begin, end) * len(vertices) + np.maximum(begin, end)
    order = np.argsort(key, kind="stable")
    pair = np.flatnonzero(key[order][1:] == key[order][:-1])
    edge, twin = order[pair], order[pair + 1]
    piece, turned = _one_way(len(triangles), edge // 3, twin // 3, begin[edge] == begin[twin])
    oriented = np.where(turned[:, None], triangles[:, [0, 2, 1]], triangles)
    # volume of each piece about the mean of its border
    changed, size = np.bincount(piece, turned), np.bincount(piece)
    corners = vertices[oriented] - vertices.mean(axis=0)
    alone = np.ones(len(key), dtype=bool)
    alone[edge] = alone[twin] = False
    border = np.flatnonzero(alone)
    middles = 0.5 * (vertices[begin[border]] + vertices[end[border]]) - vertices.mean(axis=0)
    count = np.bincount(piece[border // 3], minlength=len(size))
    middle = np.stack([np.bincount(piece[border // 3], middles[:, i], len(size)) for i in range(3)], axis=1)
    a, b, c = np.moveaxis(corners - (middle / np.maximum(count, 1)[:, None])[piece][:, None], 1, 0)
    area = np.cross(b - a, c - a)
    volume = np.bincount(piece, np.einsum("ij,ij->i", a, area))
    total = np.linalg.norm([np.bincount(piece, area[:, i]) for i in range(3)], axis=0)
    sheet = (count > 0) & (total > FLAT * np.bincount(piece, np.linalg.norm(area, axis=1)))
    closed = count == 0
    turn = np.where(sheet, changed > size / 2, volume < 0)
    if closed.sum() > 1:
        around, inwards = parents(vertices, oriented, piece), (volume < 0) != (changed > size / 2)  # in the file
        for inner in np.argsort(-np.abs(volume)):
            outer = around[inner]
            if closed[inner] and outer >= 0:
                cavity = (inwards[inner] != inwards[outer]) != (turn[outer] != (volume[outer] < 0))
                turn[inner] = (volume[inner] < 0) != cavity
    return np.ascontiguousarray(np.where(turn[piece][:, None], oriented[:, ::-1], oriented))


def _one_way(count: int, one: np.ndarray, other: np.ndarray, against: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Connected piece of each of `count` triangles, and whether it must be reversed to have the orientation of the
    first triangle of its piece.

    one, other  (E,) neighbours;  against  (E,) whether their orientations differ

    The graph has each triangle twice, as it is and reversed; a piece is one component of it and its mirror image.
    """
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * against, other + count * ~against])
    graph = scipy.sparse.csr_array((np.ones(len(rows), bool), (rows, columns)), shape=(2 * count, 2 * count))
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    upright, reverse = label.reshape(2, count)
    _, piece = np.unique(np.minimum(upright, reverse), return_inverse=True)  # numbered from triangle 0 on
    return piece, upright > reverse


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
