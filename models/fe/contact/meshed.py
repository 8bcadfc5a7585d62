"""A rigid indenter from a closed triangle mesh: its signed distance on a grid, made smooth by cubic splines.

A facetted body has no curvature on its facets and no normal on its edges, on which Newton's method chatters. Splines
have both everywhere. Edges and tips are rounded to about the spacing of the grid.
"""

import numba
import numpy as np
from scipy.ndimage import spline_filter

from palpate.models.fe.contact.rigid import Shape
from palpate.models.fe.element.mesh import MeshError, check_surface
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

CELLS = 64  # Grid cells along the longest side, unless a spacing is given
MARGIN = 4  # Grid cells round the body
MOST = 10_000_000  # Grid points that are accepted
_HEAD = 7


@numba.njit(cache=True)
def sampled(x, p, normal, curvature):
    """Cubic B-splines on a grid: p holds its first point [m] (3), spacing [m], counts (3), then the coefficients."""
    h = p[3]
    n = (int(p[4]), int(p[5]), int(p[6]))
    # the four uniform cubic B-splines that are not zero at x, with two derivatives, on each axis
    w = np.empty((3, 3, 4))  # axis, derivative, spline
    first = np.empty(3, dtype=np.int64)
    away = 0.0
    for a in range(3):
        u = (x[a] - p[a]) / h
        inside = min(max(u, 1.0), n[a] - 2.0)
        normal[a] = (u - inside) * h
        away += normal[a] ** 2
        k = min(int(inside), n[a] - 3)
        t = inside - k
        s = 1.0 - t
        first[a] = k - 1
        w[a, 0, 0], w[a, 0, 3] = s * s * s / 6.0, t * t * t / 6.0
        w[a, 0, 1], w[a, 0, 2] = 2.0 / 3.0 - t * t * (2.0 - t) / 2.0, 2.0 / 3.0 - s * s * (2.0 - s) / 2.0
        w[a, 1, 0], w[a, 1, 3] = -s * s / 2.0 / h, t * t / 2.0 / h
        w[a, 1, 1], w[a, 1, 2] = (1.5 * t * t - 2.0 * t) / h, (2.0 * s - 1.5 * s * s) / h
        w[a, 2, 0], w[a, 2, 1], w[a, 2, 2], w[a, 2, 3] = s / h**2, (3 * t - 2.0) / h**2, (3 * s - 2.0) / h**2, t / h**2
    # tensor product: value, gradient and the six second derivatives xx yy zz xy yz xz
    g = 0.0
    slope, curve = np.zeros(3), np.zeros(6)
    for i in range(4):
        for j in range(4):
            at = 7 + ((first[0] + i) * n[1] + first[1] + j) * n[2] + first[2]
            c0 = c1 = c2 = 0.0
            for k in range(4):
                c = p[at + k]
                c0 += c * w[2, 0, k]
                c1 += c * w[2, 1, k]
                c2 += c * w[2, 2, k]
            g += w[0, 0, i] * w[1, 0, j] * c0
            slope[0] += w[0, 1, i] * w[1, 0, j] * c0
            slope[1] += w[0, 0, i] * w[1, 1, j] * c0
            slope[2] += w[0, 0, i] * w[1, 0, j] * c1
            curve[0] += w[0, 2, i] * w[1, 0, j] * c0
            curve[1] += w[0, 0, i] * w[1, 2, j] * c0
            curve[2] += w[0, 0, i] * w[1, 0, j] * c2
            curve[3] += w[0, 1, i] * w[1, 1, j] * c0
            curve[4] += w[0, 0, i] * w[1, 1, j] * c1
            curve[5] += w[0, 1, i] * w[1, 0, j] * c1
    if away > 0.0:  # off the grid: on from its edge
        away = np.sqrt(away)
        for a in range(3):
            normal[a] /= away
        curvature[:] = 0.0
        return g + away
    for a in range(3):
        normal[a] = slope[a]
        curvature[a, a] = curve[a]
    curvature[0, 1] = curvature[1, 0] = curve[3]
    curvature[1, 2] = curvature[2, 1] = curve[4]
    curvature[0, 2] = curvature[2, 0] = curve[5]
    return g


def meshed(surface: Mesh, spacing: float = 0.0) -> tuple[Shape, np.ndarray]:
    """Shape and parameters of `Rigid` for the inside of a closed surface: `Rigid(faces, *meshed(surface), path)`.

    surface  triangles counter-clockwise seen from outside
    spacing  [m] of the grid, to which edges are rounded; 0: a 64th of the longest side. Where triangles stand for a
             curved surface, take about the length of their edges.

    MeshError: a surface that is not closed or is inside out; a spacing that the body is too small or too large for.
    """
    points, triangles = surface.vertices, surface.triangles
    check_surface(surface)
    if float(np.einsum("ij,ij->", surface.face_vectors, points[triangles[:, 0]])) <= 0.0:
        raise MeshError("surface: it is inside out; its triangles must be counter-clockwise seen from outside")
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    h = spacing if spacing > 0 else float(size.max()) / CELLS
    n = np.ceil(size / h).astype(np.int64) + 1 + 2 * MARGIN
    if h > size.min() / 4 or np.prod(n.astype(float)) > MOST:
        raise MeshError(
            f"spacing {h:.3g} m makes a grid of {n[0]} x {n[1]} x {n[2]} points on a surface of {size.tolist()} m: "
            f"expected 4 cells or more through its thinnest side and at most {MOST} points"
        )
    first = low - MARGIN * h
    axes = [first[k] + h * np.arange(n[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = MeshClosestPoint(surface).find(grid)[3]
    return sampled, np.concatenate([first, [h], n, spline_filter(distance, order=3).ravel()])
