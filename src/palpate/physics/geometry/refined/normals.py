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

import numpy as np

from palpate.physics.geometry.refined.fits import PART, fit_cubics, neighbours, within_edges

FEWEST, MOST = 12, 500  # neighbours, and walks over two edges, beyond which the mean remains
NEAR = 0.1  # [1] in the weights
STEEPEST = 0.36  # [1] slope of the fit above which it is not believed: 20 degrees


def fit_normals(
    points: np.ndarray, triangles: np.ndarray, means: np.ndarray, fitted: np.ndarray, breaks: np.ndarray
) -> np.ndarray:
    """Unit normals [1] (V,3) of the vertices.

    points [m], means [1] (V,3) of the vertices: their positions, and normals by their triangles; triangles (T,3)
    fitted  (k) vertices that get a normal by a fit; the others keep theirs
    breaks  (V) whether the surface is not smooth at a vertex: within two edges of it no normal is fitted
    """
    normals, near = means.copy(), neighbours(triangles, len(points))
    degree = np.diff(near.indptr)
    steps = np.bincount(np.repeat(np.arange(len(points)), degree), degree[near.indices], minlength=len(points))
    fitted = fitted[steps[fitted] < MOST]
    for begin in range(0, len(fitted), PART):
        some = fitted[begin : begin + PART]
        row, other = within_edges(near, some, 2)
        normals[some] = _fit(points, means, some, row, other, breaks)
    return normals


def _fit(
    points: np.ndarray, means: np.ndarray, some: np.ndarray, row: np.ndarray, other: np.ndarray, breaks: np.ndarray
) -> np.ndarray:
    """Normals (k,3) of the vertices `some` (k), which have the neighbours `other` (n) of the rows `row` (n)."""
    fit = fit_cubics(points, means[some], some, row, other, NEAR, free=False)
    slope = fit.terms[:, :2]
    square = slope[:, 0] ** 2 + slope[:, 1] ** 2
    broken = np.bincount(row, breaks[other].astype(float), minlength=len(some))
    smooth = (fit.number >= FEWEST) & (broken == 0.0) & ~breaks[some]
    share = np.where(smooth & (square < STEEPEST**2), square / np.maximum(square + fit.noise, 1e-300), 0.0)[:, None]
    normal = means[some] - share * (slope[:, :1] * fit.one + slope[:, 1:] * fit.two)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None])
