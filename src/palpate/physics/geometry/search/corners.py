"""The corners of triangles: those at the same place, the triangles round each, and the boxes that they span."""

import numpy as np

from palpate.compiler.exact import product
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices
from palpate.physics.geometry.search.morton import order_of


def weld(vertices: np.ndarray) -> np.ndarray:
    """Index (V,) int32 of the vertex that represents all vertices at exactly the same position."""
    key = product(vertices, np.array([1.0, np.sqrt(2.0), np.sqrt(3.0)]))
    order = order_of(key)
    inside = vertices[order]
    new = np.concatenate([[True], (inside[1:] != inside[:-1]).any(axis=1)])
    representative = np.empty(len(vertices), dtype=np.int32)
    representative[order] = order[new][np.cumsum(new) - 1]
    return representative


def stars(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The triangles round each of `count` vertices: index (V+1) where the list of each begins, and the lists (3T)."""
    at, star = np.zeros(count + 1, np.int64), np.empty(triangles.size, np.int32)
    _fill_stars(np.ascontiguousarray(triangles), at, star)
    return at, star


@kernel
def _fill_stars(triangles: Indices, at: Indices, star: Indices):
    """Fill in the results of `stars`, by counting; `at` (V+1) contains zeros."""
    for t in range(len(triangles)):
        for i in range(3):
            at[triangles[t, i]] += 1
    total = 0
    for v in range(len(at)):
        at[v], total = total, total + at[v]
    for t in range(len(triangles)):
        for i in range(3):
            star[at[triangles[t, i]]] = t
            at[triangles[t, i]] += 1
    for v in range(len(at) - 1, 0, -1):
        at[v] = at[v - 1]
    at[0] = 0


def boxes_of(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner [m] (T,3) of the box of each triangle (T,3)."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
