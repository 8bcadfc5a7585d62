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

from typing import Any

import numpy as np

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.refined.fits import PART, Fit, fit_cubics, neighbours, within_edges

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
    near, breaks = neighbours(mesh.triangles.astype(np.int64), len(mesh.vertices)), np.zeros(len(mesh.vertices), bool)
    breaks[sharp] = breaks[corner] = True
    some = np.unique(np.linspace(0, len(breaks) - 1, SAMPLE).astype(np.int64))
    narrow, wider, smooth = _fits(mesh, near, breaks, some)
    residual = np.sqrt(narrow.noise)
    rough = smooth & (residual > LEAST)
    if rough.sum() < ENOUGH * len(some):
        return mesh
    growth = np.sqrt(wider.noise) * wider.wide / np.maximum(residual * narrow.wide, 1e-300)
    usual = float(np.median(residual[rough]))
    if usual > MOST or np.median(growth[rough]) > GROWS:
        return mesh
    parts = [np.arange(at, min(at + PART, len(breaks))) for at in range(0, len(breaks), PART)]
    offset = np.concatenate([_offset(*_fits(mesh, near, breaks, part), usual) for part in parts])
    return Mesh(mesh.vertices + offset[:, None] * mesh.normals, mesh.triangles)


def _fits(mesh: Mesh, near: Any, breaks: np.ndarray, some: np.ndarray) -> tuple[Fit, Fit, np.ndarray]:
    """The fits within two edges and three to the vertices `some` (k), and whether the surface is smooth there."""
    fits, smooth = [], ~breaks[some]
    for edges in (2, 3):
        row, other = within_edges(near, some, edges, itself=True)
        fits.append(fit_cubics(mesh.vertices, mesh.normals[some], some, row, other, NEAR, free=True))
        smooth &= np.bincount(row, breaks[other].astype(float), minlength=len(some)) == 0.0
    return *fits, smooth & (fits[1].number >= FEWEST)


def _offset(narrow: Fit, wider: Fit, smooth: np.ndarray, usual: float) -> np.ndarray:
    """How far [m] (k) vertices are to move along their normals; `usual`: median of the residuals [1]."""
    most = LIMIT * np.maximum(np.sqrt(narrow.noise), usual) * narrow.wide
    return np.where(smooth, np.clip(wider.terms[:, 0] * wider.wide, -most, most), 0.0)
