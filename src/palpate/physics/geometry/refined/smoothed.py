"""Vertices that scatter round a smooth surface, moved onto it.

Marching cubes interpolate an image linearly between its voxels. On an ellipsoid of 45, 30 and 20 mm in voxels of 2 mm
their vertices are 9 um (root mean square) off a smooth surface, and up to 50 um, with the normals 0.8 degrees off. A
patch of 8 mm does not feel bumps of 2 mm, but a foot that follows these normals makes the force rough.

A cubic is fitted through the vertices within two edges, and one within three (`fits`). Where the surface is smooth, but
coarse, the residual of the fit grows with the fourth power of its width, 4 times from two edges to three. That of
scatter does not. So the mesh scatters if, where the residual is above `LEAST` of the width of the fit, its median is
below `MOST` of it, and grows by less than `GROWS` from two edges to three. Then each vertex moves to the wider fit, by
at most twice the residual of the narrower or that median, except near edges, corners and borders. On that ellipsoid the
vertices then are 4 um off, and after the division the normals 0.15 degrees.
"""

import numpy as np

from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Indices, Matrix, Record
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.refined.edge_list import neighbours_of
from palpate.physics.geometry.refined.fits import FIT, TERMS, fill_places, fit_cubic, within_edges

SAMPLE = 500  # vertices that decide whether a mesh scatters
ENOUGH = 0.1  # [1] share of them with a residual above `LEAST`
LEAST, MOST = 7e-4, 0.03  # [1] residual over the width of the fit
GROWS = 2.2  # [1] residual within three edges over that within two
FEWEST = 20  # vertices of the wider fit below which a vertex stays
NEAR = 1.0  # [1] in the weights of the fit
LIMIT = 2.0  # [1] motion over the residual


def smooth_vertices(mesh: Mesh, sharp: np.ndarray, corner: np.ndarray) -> Mesh:
    """The mesh with its vertices on a smooth surface; the same object if they do not scatter round one.

    sharp, corner  (K,2), (C) where the surface is not smooth, see `creases`
    """
    near, breaks = neighbours_of(mesh.triangles, len(mesh.vertices)), np.zeros(len(mesh.vertices), bool)
    breaks[sharp] = breaks[corner] = True
    some = np.unique(np.linspace(0, len(breaks) - 1, SAMPLE).astype(np.int64))
    narrow, wider, smooth = _fits(mesh, near, breaks, some, 0.0)
    residual = np.sqrt(narrow["noise"])
    rough = smooth & (residual > LEAST)
    if rough.sum() < ENOUGH * len(some):
        return mesh
    growth = np.sqrt(wider["noise"]) * wider["wide"] / np.maximum(residual * narrow["wide"], 1e-300)
    usual = float(np.median(residual[rough]))
    if usual > MOST or np.median(growth[rough]) > GROWS:
        return mesh
    narrow, wider, smooth = _fits(mesh, near, breaks, np.arange(len(breaks)), usual)
    most = LIMIT * np.maximum(np.sqrt(narrow["noise"]), usual) * narrow["wide"]
    offset: np.ndarray = wider["terms"][:, 0] * wider["wide"]
    offset = np.where(smooth, np.clip(offset, -most, most), 0.0)
    return Mesh(mesh.vertices + offset[:, None] * mesh.normals, mesh.triangles)


def _fits(
    mesh: Mesh, near: tuple[np.ndarray, np.ndarray], breaks: np.ndarray, some: np.ndarray, usual: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The fits (`FIT`) within two edges and three to the vertices `some` (k), and whether the surface is smooth there;
    zero where it is not. Of the narrower fit only the width is known where the vertex is within `LIMIT` times the
    `usual` residual of the wider fit [1], so that its residual does not matter."""
    fits, smooth, count = np.zeros((2, len(some)), FIT), np.zeros(len(some), bool), len(breaks)
    scratch = np.full(count, -1), np.empty(count, np.int64), np.empty((count, 3))
    equations = np.empty((1, TERMS + 1, TERMS + 1)), np.empty((1, TERMS + 1, 1))
    _fill(mesh.vertices, mesh.normals, *near, breaks, some, usual, fits, smooth, *scratch, *equations)
    return fits[0], fits[1], smooth


@ieee_kernel
def _fill(
    points: Matrix, normals: Matrix, at: Indices, near: Indices, breaks: Indices, some: Indices, usual: float,
    fits: Record, smooth: Indices, seen: Indices, found: Indices, places: Matrix, left: Matrix, right: Matrix,
):  # fmt: skip
    """Fill the results of `_fits`; workspaces last."""
    for k, v in enumerate(some):
        size = within_edges(at, near, v, 3, True, found, seen)
        smooth[k] = size >= FEWEST and not breaks[v]
        for n in range(size):
            smooth[k] = smooth[k] and not breaks[found[n]]
        if smooth[k]:
            smooth[k] = fit_cubic(points, normals[v], v, found, size, NEAR, True, fits[1, k], places, left, right)
            size, narrow = within_edges(at, near, v, 2, True, found, seen), fits[0, k]
            fill_places(points, normals[v], v, found, size, narrow, places)
            if abs(fits[1, k].terms[0] * fits[1, k].wide) > LIMIT * usual * narrow.wide:
                fit_cubic(points, normals[v], v, found, size, NEAR, True, narrow, places, left, right)
