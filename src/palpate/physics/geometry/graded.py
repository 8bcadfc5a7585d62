"""Graded sampling of a displacement field: all vertices near the contact, fewer with increasing distance.

An elastic surface moves by about 1/r at the distance r from the load. Linear interpolation between points at a spacing
h has the relative error h²/(4 r²), which is 3 % for h = `GRADE` r at any distance.

Vertices are ranked by farthest-point sampling (T. F. Gonzalez, Theor. Comput. Sci. 38 (1985) 293-306): each is the
farthest from all before it. A vertex at the distance h from these is sent up to h/`GRADE` beyond the region in which
all vertices are sent. The receiver interpolates (`fill_field`).
"""

import numpy as np

from palpate.compiler.exact import einsum, solve
from palpate.physics.kept import keep_results
from palpate.physics.nearest import nearest, tree_of

GRADE = 0.35  # [1] Spacing of the sent vertices over their distance from the region in which all are sent
RANKED = 600  # Number of ranked vertices; the others are sent only near the contact
EVERYWHERE = 150  # Number of vertices that are always sent, for the motion of the body as a whole
LANDMARKS = 16  # Number of vertices by which a receiver recognizes a list that covers the whole surface
SAMPLED = 20_000  # Largest number of candidates for the ranking of a large mesh
NEIGHBOURS = 12  # Number of sent vertices from which another one is interpolated
STIFF = 1e-4  # [1] Regularization of the linear fit: the neighbours are nearly coplanar


def rank_vertices(points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The first `count` vertices by farthest-point sampling, and the distance [m] of each from all before it."""
    chosen = np.arange(0, len(points), -(-len(points) // SAMPLED))
    some = points[chosen]
    count = min(count, len(some))
    order, apart = np.zeros(count, dtype=np.int64), np.full(count, np.inf)
    away = np.linalg.norm(some - some[0], axis=1)
    for rank in range(1, count):
        order[rank] = away.argmax()
        apart[rank] = away[order[rank]]
        away = np.minimum(away, np.linalg.norm(some - some[order[rank]], axis=1))
    return chosen[order], apart


@keep_results
def ranges(points: np.ndarray, near: float) -> np.ndarray:
    """Distance [m] (N,) from the contact up to which each vertex is sent. points [m] (N,3); near [m]: distance within
    which all are sent"""
    order, apart = rank_vertices(points, RANKED)
    within = np.full(len(points), near)
    within[order] = near + apart / GRADE
    within[order[:EVERYWHERE]] = np.inf
    return within


@keep_results
def landmarks(points: np.ndarray) -> np.ndarray:
    """Indices of `LANDMARKS` points that are far from each other, of points [m] (N,3)."""
    return rank_vertices(points, LANDMARKS)[0]


def spread_over(points: np.ndarray, nodes: np.ndarray) -> bool:
    """Whether the vertices `nodes` are a sample of the whole surface, which includes all landmarks, so that the other
    vertices can be interpolated. A list of the vertices near a contact never includes all landmarks."""
    return len(nodes) < len(points) and bool(np.isin(landmarks(points), nodes).all())


def fill_field(points: np.ndarray, nodes: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """The field (N,c) at all points [m] (N,3), interpolated from `moved` (k,c) at `nodes` (k,).

    Linear moving least squares over the nearest nodes, with weights that are zero at the farthest one; exact for linear
    fields. P. Lancaster, K. Salkauskas, Math. Comput. 37 (1981) 141-158.
    """
    field = np.zeros((len(points), moved.shape[1]))
    field[nodes] = moved
    between = np.setdiff1d(np.arange(len(points)), nodes)
    if len(nodes) < NEIGHBOURS or not len(between):
        return field
    away, near = nearest(tree_of(points[nodes]), points[between], NEIGHBOURS)
    far = np.maximum(away[:, -1:], 1e-12)
    q = np.minimum(away / far, 1.0) ** 2
    weight = (1.0 - q) ** 2 / (q + 1e-2)
    terms = np.concatenate(
        [np.ones_like(q)[..., None], (points[nodes[near]] - points[between][:, None]) / far[..., None]], 2
    )
    normal = einsum("nk,nki,nkj->nij", weight, terms, terms)
    total = weight.sum(axis=1)
    normal[:, [1, 2, 3], [1, 2, 3]] += STIFF * total[:, None]
    first = np.zeros((len(between), 4, 1))
    first[:, 0] = 1.0
    shares = weight * einsum("nki,ni->nk", terms, solve(normal, first)[..., 0])
    field[between] = einsum("nk,nkc->nc", shares, moved[near])
    return field
