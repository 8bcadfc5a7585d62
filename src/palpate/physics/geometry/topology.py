"""Topology of a triangle mesh: borders, non-manifold edges, consistent orientation."""

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum
from palpate.physics.geometry.pieces import parents
from palpate.physics.geometry.refined.edge_list import edges_of


def edge_counts(triangles: np.ndarray, vertices: int) -> tuple[int, int]:
    """Number of border edges, with one triangle (0: closed), and of non-manifold edges, with more than two."""
    count = np.bincount(edges_of(triangles, vertices)[1].ravel())
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
    volume = np.bincount(piece, einsum("ij,ij->i", a, area))
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


def one_sided(triangles: np.ndarray) -> bool:
    """Whether two of the triangles, oriented by `outward`, go along an edge in the same direction: then no orientation
    exists in which none do."""
    begin, end = triangles.ravel().astype(np.int64), np.roll(triangles, -1, axis=1).ravel()
    keys = np.sort(begin * (int(triangles.max()) + 1) + end)
    return bool((keys[1:] == keys[:-1]).any())


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
