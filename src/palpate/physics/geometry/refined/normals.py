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

from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Indices, Matrix, Record
from palpate.physics.geometry.refined.edge_list import neighbours_of
from palpate.physics.geometry.refined.fits import FIT, TERMS, fit_cubic, within_edges

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
    normals = means.copy()
    at, near = neighbours_of(triangles, len(points))
    scratch = np.full(len(points), -1), np.empty(MOST + 1, np.int64), np.zeros(1, FIT), np.empty((MOST + 1, 3))
    _fit_normals(points, means, at, near, fitted, breaks, normals, *scratch, np.empty((1, TERMS, TERMS)),
                 np.empty((1, TERMS, 1)))  # fmt: skip
    return normals


@ieee_kernel
def _fit_normals(
    points: Matrix, means: Matrix, at: Indices, near: Indices, fitted: Indices, breaks: Indices, normals: Matrix,
    seen: Indices, found: Indices, fits: Record, places: Matrix, left: Matrix, right: Matrix,
):  # fmt: skip
    """Fill in the normals (V,3) of the fitted vertices; workspaces last. Where a fit is not believed, the mean is."""
    fit = fits[0]
    for v in fitted:
        walks = 0
        for n in range(at[v], at[v + 1]):
            walks += at[near[n] + 1] - at[near[n]]
        if walks >= MOST:
            continue
        size = within_edges(at, near, v, 2, False, found, seen)
        smooth = size >= FEWEST and not breaks[v]
        for k in range(size):
            smooth = smooth and not breaks[found[k]]
        share = first = second = 0.0
        if smooth and fit_cubic(points, means[v], v, found, size, NEAR, False, fit, places, left, right):
            first, second = fit.terms[0], fit.terms[1]
            square = first * first + second * second
            if square < STEEPEST**2:
                share = square / max(square + fit.noise, 1e-300)
        length, normal = 0.0, normals[v]
        for i in range(3):
            if smooth:
                normal[i] = means[v, i] - share * (first * fit.one[i] + second * fit.two[i])
            length += normal[i] * normal[i]
        length = max(np.sqrt(length), 1e-300)
        for i in range(3):
            normal[i] /= length
