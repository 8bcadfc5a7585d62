"""Topology of a triangle mesh: borders, non-manifold edges, and consistent orientation."""

import numpy as np

from palpate.physics.kernel import kernel


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

    vertices [m] (V,3), triangles (T,3). Closed pieces that are consistent keep their relative orientation, so that a
    cavity remains a cavity; a piece that was corrected gets positive volume. An open piece gets positive volume about
    the mean of its border, as if its hole were closed. A sheet (`FLAT`) has no inside and gets the orientation of most
    of its triangles.
    """
    oriented = np.ascontiguousarray(triangles, dtype=np.int32).copy()
    across = _across(oriented, len(vertices))
    piece, turned = _one_way(oriented, across)
    changed, size = np.bincount(piece, turned), np.bincount(piece)
    corners = vertices[oriented] - vertices.mean(axis=0)
    of, edge = np.nonzero(across < 0)
    border = 0.5 * (corners[of, edge] + corners[of, (edge + 1) % 3])
    count = np.bincount(piece[of], minlength=len(size))
    middle = np.stack([np.bincount(piece[of], border[:, i], len(size)) for i in range(3)], axis=1)
    a, b, c = np.moveaxis(corners - (middle / np.maximum(count, 1)[:, None])[piece][:, None], 1, 0)
    area = np.cross(b - a, c - a)
    volume = np.bincount(piece, np.einsum("ij,ij->i", a, area))
    total = np.linalg.norm([np.bincount(piece, area[:, i]) for i in range(3)], axis=0)
    sheet = (count > 0) & (total > FLAT * np.bincount(piece, np.linalg.norm(area, axis=1)))
    closed = count == 0
    turn = np.where(closed, (changed > 0) & (volume < 0), np.where(sheet, changed > size / 2, volume < 0))
    if np.where(turn, -volume, volume)[closed].sum() < 0:
        turn[closed] = ~turn[closed]
    oriented[turn[piece]] = oriented[turn[piece]][:, ::-1]
    return oriented


def _across(triangles: np.ndarray, vertices: int) -> np.ndarray:
    corners = triangles.astype(np.int64)
    other = np.roll(corners, -1, axis=1)
    key = (np.minimum(corners, other) * vertices + np.maximum(corners, other)).ravel()
    order = np.argsort(key, kind="stable")
    pair = np.flatnonzero(key[order][1:] == key[order][:-1])
    neighbours = np.full(key.size, -1, dtype=np.int64)
    neighbours[order[pair]], neighbours[order[pair + 1]] = order[pair + 1] // 3, order[pair] // 3
    return neighbours.reshape(-1, 3)


@kernel
def _one_way(triangles, across):
    """Give the triangles of each connected piece the orientation of its first one, by flood fill; piece of each
    triangle, and whether it was reversed."""
    count = len(triangles)
    piece = np.full(count, -1, dtype=np.int64)
    stack = np.empty(count, dtype=np.int64)
    turned = np.zeros(count, dtype=np.bool_)
    pieces = 0
    for seed in range(count):
        if piece[seed] >= 0:
            continue
        piece[seed] = pieces
        stack[0] = seed
        depth = 1
        while depth > 0:
            depth -= 1
            t = stack[depth]
            for i in range(3):
                s = across[t, i]
                if s < 0 or piece[s] >= 0:
                    continue
                for e in range(3):
                    if across[s, e] != t:
                        continue
                    for j in range(3):
                        x, y = triangles[t, j], triangles[t, (j + 1) % 3]
                        if triangles[s, e] == x and triangles[s, (e + 1) % 3] == y:
                            triangles[s, 1], triangles[s, 2] = triangles[s, 2], triangles[s, 1]
                            across[s, 0], across[s, 2] = across[s, 2], across[s, 0]
                            turned[s] = True
                            break
                    break
                piece[s] = pieces
                stack[depth] = s
                depth += 1
        pieces += 1
    return piece, turned
