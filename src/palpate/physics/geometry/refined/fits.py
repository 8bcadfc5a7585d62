"""Cubic height functions of the mean normal, fitted to the vertices round each of some vertices of a mesh."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum, solve

DEGREE = 3
RIDGE = 1e-9  # [1] regularization of coefficients that few neighbours do not determine
PART = 1000  # vertices at a time, whose tables fit into a cache


class Fit(NamedTuple):
    """For each of k vertices, z = sum c_ij x^i y^j with x, y and z over `wide`."""

    one: np.ndarray  # [1] (k,3) axis of x
    two: np.ndarray  # [1] (k,3) axis of y
    wide: np.ndarray  # [m] (k) root mean square distance of the neighbours
    number: np.ndarray  # [1] (k) of neighbours, at least 1
    terms: np.ndarray  # [1] (k,9) c_10, c_01, ..., or (k,10) from c_00 on
    noise: np.ndarray  # [1] (k) variance of the residual


def neighbours(triangles: np.ndarray, count: int) -> Any:
    """Matrix (V,V) with a number above 0 for each pair of vertices that share an edge."""
    one, two = triangles[:, [0, 1, 1, 2, 2, 0]].ravel(), triangles[:, [1, 0, 2, 1, 0, 2]].ravel()
    return scipy.sparse.coo_array((np.ones(len(one), np.int32), (one, two)), shape=(count, count)).tocsr()


def within_edges(near: Any, some: np.ndarray, edges: int, itself: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Each pair of a vertex and another one (or also itself) within some edges: its place in `some` (k) and the other
    one, in order."""
    around = near[some]
    for _ in range(edges - 1):
        around = around @ near + near[some]
    around.sort_indices()
    row = np.repeat(np.arange(len(some)), np.diff(around.indptr))
    if itself:
        return row, around.indices
    apart = around.indices != some[row]
    return row[apart], around.indices[apart]


def fit_cubics(
    points: np.ndarray, along: np.ndarray, some: np.ndarray, row: np.ndarray, other: np.ndarray, near: float, free: bool
) -> Fit:
    """Weighted least squares for the vertices `some` (k), with the neighbours `other` (n) of the rows `row` (n).

    points [m] (V,3);  along [1] (k,3) axes of z;  near [1] in the weights 1/((r/wide)² + near), r the distance
    free  whether c_00 is fitted; else the surface goes through the vertex
    """
    size = len(some)

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(row, values, minlength=size)

    first = np.where(np.abs(along[:, :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    one = np.cross(along, first)
    one /= np.maximum(np.linalg.norm(one, axis=1), 1e-300)[:, None]
    two = np.cross(along, one)
    away, number = points[other] - points[some[row]], np.maximum(total(np.ones(len(row))), 1.0)
    x, y, z = (einsum("ij,ij->i", away, axis[row]) for axis in (one, two, along))
    wide = np.maximum(np.sqrt(total(x * x + y * y) / number), 1e-300)
    x, y, z = x / wide[row], y / wide[row], z / wide[row]
    # by the moments of x and y up to the sixth
    weight = 1.0 / (x * x + y * y + near)
    terms = _powers(x, y, DEGREE, free)
    moments = {powers: total(weight * term) for powers, term in _powers(x, y, 2 * DEGREE, free).items()}
    lift = weight * z
    left, right = np.zeros((size, len(terms), len(terms))), np.zeros((size, len(terms), 1))
    for i, (one_power, term) in enumerate(terms.items()):
        right[:, i, 0] = total(lift * term)
        for j, other_power in enumerate(terms):
            left[:, i, j] = moments[one_power[0] + other_power[0], one_power[1] + other_power[1]]
    diagonal = np.arange(len(terms))
    left[:, diagonal, diagonal] += 1e-30 + RIDGE * left.max(axis=(1, 2))[:, None]
    solution = solve(left, right)[:, :, 0]
    for i, term in enumerate(terms.values()):
        z = z - solution[row, i] * term
    spare = number / np.maximum(number - len(terms), 1.0)
    noise = total(weight * z * z) / np.maximum(total(weight), 1e-300) * spare
    return Fit(one, two, wide, number, solution, noise)


def _powers(x: np.ndarray, y: np.ndarray, most: int, free: bool) -> dict[tuple[int, int], np.ndarray]:
    """x^i y^j (n) by (i, j), 1 <= i + j <= `most`, or 0 <= i + j."""
    powers = {(0, 0): np.ones(len(x))} if free else {}
    powers |= {(1, 0): x, (0, 1): y}
    for k in range(2, most + 1):
        for j in range(k):
            powers[k - j, j] = powers[k - j - 1, j] * x
        powers[0, k] = powers[0, k - 1] * y
    return powers
