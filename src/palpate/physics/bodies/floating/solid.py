"""Centre and radius of gyration of the homogeneous solid in a closed surface, or of a thin open surface.

The solid is a sum of tetrahedra (0, a, b, c) of the volume V = a.(b x c)/6, whose second moments are
V/20 (aa' + bb' + cc' + ss'), s = a + b + c (F. Tonon, J. Math. Stat. 1 (2005) 8-11).
"""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh


def centre_of(mesh: Mesh) -> tuple[np.ndarray, float]:
    """Centre of mass [m] (3), and the radius of gyration [m] of a sphere with the mean of its principal moments of
    inertia, sqrt(tr(J)/(3 m))."""
    middle = mesh.vertices.mean(axis=0)
    if mesh.closed:
        a, b, c = (mesh.vertices[mesh.triangles[:, i]] - middle for i in range(3))
        volume = einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
        total, s = volume.sum(), a + b + c
        centre = (volume[:, None] * s).sum(axis=0) / (4.0 * total)
        square = (volume * sum((x * x).sum(axis=1) for x in (a, b, c, s))).sum() / (20.0 * total)
    else:
        at = mesh.vertices - middle
        centre = (mesh.areas[:, None] * at).sum(axis=0) / mesh.areas.sum()
        square = (mesh.areas * (at * at).sum(axis=1)).sum() / mesh.areas.sum()
    return middle + centre, float(np.sqrt(2.0 / 3.0 * (square - (centre * centre).sum())))
