"""Normals of a smooth surface at the vertices of a coarse mesh, by local fits.

Means of the normals of the triangles round a vertex have errors of second order in the length h of the edges, about
(h/2)² times the change of the curvature, and on a sphere of uneven triangles as well. A polynomial of degree m through
the vertex and its neighbours in a height function has the normal to O(h^m) (osculating jets: F. Cazals, M. Pouget,
Comput. Aided Geom. Des. 22 (2005) 121-146). Here m = 3, over the vertices within two edges (18 in a regular mesh):

    z = sum_{1 <= i+j <= 3} c_ij x^i y^j,    n ~ n_0 - c_10 e_x - c_01 e_y,

z [m] along the mean normal n_0, weighted by 1/(r² + 0.1 s²), r the distance and s its root mean square. The fit follows
noise 1.3 times as much as the mean does. So the slope c = (c_10, c_01) counts by |c|²/(|c|² + e²), e being the standard
deviation of the residual over s: where the fit differs less from the mean than the noise explains, the mean remains.
With noise of 1 % of h the errors are 1.1 times those of the mean, without noise 2 to 50 times smaller.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum, solve

FEWEST, MOST = 12, 500  # neighbours, and walks over two edges, beyond which the mean remains
NEAR = 0.1  # [1] in the weights
STEEPEST = 0.36  # [1] slope of the fit above which it is not believed: 20 degrees
RIDGE = 1e-9  # [1] regularization of coefficients that few neighbours do not determine
PART = 1000  # vertices at a time, whose tables fit into a cache


def fit_normals(
    points: np.ndarray, triangles: np.ndarray, means: np.ndarray, fitted: np.ndarray, breaks: np.ndarray
) -> np.ndarray:
    """Unit normals [1] (V,3) of the vertices.

    points [m], means [1] (V,3) of the vertices: their positions, and normals by their triangles; triangles (T,3)
    fitted  (k) vertices that get a normal by a fit; the others keep theirs
    breaks  (V) whether the surface is not smooth at a vertex: within two edges of it no normal is fitted
    """
    normals, near = means.copy(), _neighbours(triangles, len(points))
    degree = np.diff(near.indptr)
    steps = np.bincount(np.repeat(np.arange(len(points)), degree), degree[near.indices], minlength=len(points))
    fitted = fitted[steps[fitted] < MOST]
    for begin in range(0, len(fitted), PART):
        some = fitted[begin : begin + PART]
        row, other = _within_two_edges(near, some)
        normals[some] = _fit(points, means, some, row, other, breaks)
    return normals


def _neighbours(triangles: np.ndarray, count: int) -> Any:
    """Matrix (V,V) with a number above 0 for each pair of vertices that share an edge."""
    one, two = triangles[:, [0, 1, 1, 2, 2, 0]].ravel(), triangles[:, [1, 0, 2, 1, 0, 2]].ravel()
    return scipy.sparse.coo_array((np.ones(len(one), np.int32), (one, two)), shape=(count, count)).tocsr()


def _within_two_edges(near: Any, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each pair of a vertex and another one within two edges: its place in `some` (k) and the other one, in order."""
    around = near[some] @ near + near[some]
    around.sort_indices()
    row = np.repeat(np.arange(len(some)), np.diff(around.indptr))
    apart = around.indices != some[row]
    return row[apart], around.indices[apart]


def _fit(
    points: np.ndarray, means: np.ndarray, some: np.ndarray, row: np.ndarray, other: np.ndarray, breaks: np.ndarray
) -> np.ndarray:
    """Normals (k,3) of the vertices `some` (k), which have the neighbours `other` (n) of the rows `row` (n)."""
    size, along = len(some), means[some]

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
    # the weighted least squares, by the moments of x and y up to the sixth
    weight = 1.0 / (x * x + y * y + NEAR)
    terms = _powers(x, y, 3)
    moments = {powers: total(weight * term) for powers, term in _powers(x, y, 6).items()}
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
    # the share of the fit
    spare = number / np.maximum(number - len(terms), 1.0)
    noise = total(weight * z * z) / np.maximum(total(weight), 1e-300) * spare  # squared
    square = solution[:, 0] ** 2 + solution[:, 1] ** 2
    smooth = (number >= FEWEST) & (total(breaks[other].astype(float)) == 0.0) & ~breaks[some]
    share = np.where(smooth & (square < STEEPEST**2), square / np.maximum(square + noise, 1e-300), 0.0)[:, None]
    normal = along - share * (solution[:, :1] * one + solution[:, 1:2] * two)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None])


def _powers(x: np.ndarray, y: np.ndarray, most: int) -> dict[tuple[int, int], np.ndarray]:
    """x^i y^j (n) by (i, j), 1 <= i + j <= `most`."""
    powers = {(1, 0): x, (0, 1): y}
    for k in range(2, most + 1):
        for j in range(k):
            powers[k - j, j] = powers[k - j - 1, j] * x
        powers[0, k] = powers[0, k - 1] * y
    return powers
