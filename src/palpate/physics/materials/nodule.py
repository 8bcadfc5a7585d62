"""A hard spherical nodule in soft tissue, as a map of stiffness over the surface.

A first-order estimate: the stress below a load is that of homogeneous tissue, the strain that of the local modulus. On
the axis of a uniform pressure over a circle of radius R on an incompressible half-space, the displacement at depth z is

    u(z)/u(0) = 1/sqrt(1 + (z/R)²)

so the layer between the depths z1 and z2 contributes the share W = u(z1)/u(0) - u(z2)/u(0) of the indentation. If that
layer is `ratio` times stiffer, the surface is stiffer by

    k = 1/(1 - W (1 - 1/ratio))

A region of another shape, such as a vessel, has several layers in a column, and W is the sum of their shares. Load
passes by a soft one through the tissue around it, so there the strain is that of homogeneous tissue and the stress that
of the local modulus:

    k = 1 - W (1 - ratio),   ratio < 1

Both agree to first order in W (ratio - 1).

Neglected: the stress concentration in the nodule, the shear between neighbouring columns, and rigid motion of the
nodule. The position and the trend with depth, size and ratio are reliable; for the magnitude use ReducedFE.
"""

from collections.abc import Callable

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.arrays import Points, Vector


def nodule_centre(vertices: Points, normals: Points, position: Vector, depth: float) -> np.ndarray:
    """Centre [m] (3) of a nodule that lies `depth` [m] below the point of the surface at `position` [m] (3), along the
    normal of the nearest of its vertices [m] (V,3)."""
    nearest = int(np.argmin(np.sum((np.asarray(vertices) - position) ** 2, axis=1)))
    normal = np.asarray(normals)[nearest]
    above = np.sum((np.asarray(position, float) - np.asarray(vertices)[nearest]) * normal)
    return np.asarray(position, float) - (above + depth) * normal


def stiffness_map(
    vertices: Points, normals: Points, centre: Vector, radius: float, ratio: float, reach: float
) -> np.ndarray:
    """Factor k [1] (V) on the stiffness of each surface vertex above a nodule; exactly 1 where none lies below.

    The column below a vertex runs along its inward normal; z1 and z2 are the depths where it enters and leaves the
    sphere (0 where the sphere reaches the surface).

    vertices [m] (V,3), normals [1] (V,3) outward   undeformed surface
    centre [m] (3), radius [m] > 0                  of the nodule
    ratio [1] > 0    its modulus over that of the tissue
    reach [m] > 0    R, radius over which a fingertip spreads its load

    ValueError: an argument out of its range. K. L. Johnson, Contact Mechanics (1985), section 3.4(a).
    """
    for name, value in {"radius": radius, "ratio": ratio, "reach": reach}.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: found {value}, expected a finite number > 0")
    to_centre = np.asarray(centre, float) - np.asarray(vertices, float)
    along = -einsum("vi,vi->v", to_centre, np.asarray(normals, float))
    lateral = np.maximum(einsum("vi,vi->v", to_centre, to_centre) - along**2, 0.0)
    half = np.sqrt(np.maximum(radius**2 - lateral, 0.0))
    top, bottom = np.maximum(along - half, 0.0), np.maximum(along + half, 0.0)
    share = 1.0 / np.sqrt(1.0 + (top / reach) ** 2) - 1.0 / np.sqrt(1.0 + (bottom / reach) ** 2)
    return 1.0 / (1.0 - np.where(half > 0, share, 0.0) * (1.0 - 1.0 / ratio))


def column_map(
    vertices: Points, normals: Points, contains: Callable[[np.ndarray], np.ndarray], ratio: float, reach: float,
    step: float,
) -> np.ndarray:  # fmt: skip
    """Factor k [1] (V) on the stiffness of each surface vertex above a region of any shape; exactly 1 where none lies
    below. As `stiffness_map`, with W the sum over the layers of the column, each `step` [m] thick, whose middle is in
    the region. A column ends at 8 times the reach, below which lies 1/8 of the indentation.

    contains  whether points [m] (V,3) are in the region

    ValueError: an argument out of its range.
    """
    for name, value in {"step": step, "ratio": ratio, "reach": reach}.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: found {value}, expected a finite number > 0")
    vertices, normals = np.asarray(vertices, float), np.asarray(normals, float)
    share, count = np.zeros(len(vertices)), int(np.ceil(8.0 * reach / step))
    for layer in range(count):
        top, bottom = layer * step, (layer + 1) * step
        inside = contains(vertices - 0.5 * (top + bottom) * normals)
        part = 1.0 / np.sqrt(1.0 + (top / reach) ** 2) - 1.0 / np.sqrt(1.0 + (bottom / reach) ** 2)
        share += np.where(inside, part, 0.0)
    return np.asarray(1.0 - share * (1.0 - ratio) if ratio < 1.0 else 1.0 / (1.0 - share * (1.0 - 1.0 / ratio)))
