"""The topology of a triangle mesh: closed or open, manifold or not, and its triangles oriented consistently."""

import numpy as np

from palpate.physics.kernel import kernel


def edge_counts(triangles: np.ndarray, vertices: int) -> tuple[int, int]:
    """Number of edges that one triangle has (the border; 0: closed) and of edges that more than two share."""
    ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    _, count = np.unique(ends[:, 0] * vertices + ends[:, 1], return_counts=True)
    return int((count == 1).sum()), int((count > 2).sum())


def outward(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles of a manifold mesh, each piece oriented consistently; a closed mesh gets positive volume.

    vertices [m] (V,3), triangles (T,3). Where the pieces of a closed mesh are consistent already they keep their sense
    towards each other, so that a cavity stays a cavity; a piece that had to be mended is turned to positive volume by
    itself. An open piece gets the sense that most of its triangles have.
    """
    oriented = np.ascontiguousarray(triangles, dtype=np.int32).copy()
    across = _across(oriented, len(vertices))
    closed = bool((across >= 0).all())
    piece, turned = _one_way(oriented, across)
    changed = np.bincount(piece, turned)
    if closed:
        a, b, c = (vertices[oriented[:, i]] for i in range(3))
        part = np.bincount(piece, np.einsum("ij,ij->i", a, np.cross(b, c)))
        turn = (changed > 0) & (part < 0)
        if np.where(turn, -part, part).sum() < 0:
            turn = ~turn
    else:
        turn = changed > np.bincount(piece) / 2
    oriented[turn[piece]] = oriented[turn[piece]][:, ::-1]
    return oriented


def _across(triangles: np.ndarray, vertices: int) -> np.ndarray:
    """The triangle across each edge, -1 where there is none (T,3)."""
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
    """Turns the triangles of each piece to the sense of its first; piece of each, and whether it was turned."""
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
