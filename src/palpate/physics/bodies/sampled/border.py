"""The displacement of a drawn surface past the border of a basis.

A stored basis may describe a part of an organ, as the last 22 mm of a finger, while the drawn surface continues. Its
vertices there move like the nearest point of the border, less with their distance d from it: by the share
(1 - d/R)² (1 + 2 d/R), and not at all from d = R on, the smallest distance of the border from its middle. Up to that
distance the nearest point changes smoothly if the border is a circle: it leaps only on the axis, whose points are R and
more away. Forces are not concerned.
"""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh


def shares_past_border(coarse: Mesh, points: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Share [1] (N,) in the displacement of the nearest point of a coarse surface with one border at most, by which
    each of the points [m] (N,3) moves: 1 where it is not nearest to the border.

    corners, weights  (N,3) of the nearest points, see `patch.barycentric`
    """
    border = coarse.border
    shares = np.ones(len(points))
    if not len(border):
        return shares
    rim = coarse.vertices[border]
    out = rim - einsum("ni->i", rim) / len(rim)
    radius = np.sqrt(einsum("ni,ni->n", out, out)).min()
    past = points - einsum("nk,nki->ni", weights, coarse.vertices[corners])
    x = np.minimum(np.sqrt(einsum("ni,ni->n", past, past)) / radius, 1.0)
    at_border = ((weights < 1e-9) | np.isin(corners, border)).all(axis=1)
    shares[at_border] = ((1.0 - x) ** 2 * (1.0 + 2.0 * x))[at_border]
    return shares
