"""The patch of a foot that is off the surface moves evenly."""

import math

import numpy as np

from palpate.physics.contact.spread import Spreader, spread, spreader
from palpate.physics.geometry.mesh import Mesh

STEP = 5e-5  # [m]
DIP = 0.65e-3  # [m] of the rim of a groove of 8 mm


def centre_of(patch: Spreader, at: float) -> tuple[float, bool]:
    """The centre of the patch [m] across a rim at y = 0, and whether it is widened, of a foot at y = `at` [m] on a
    bridge that is inclined by 0.16, as next to a groove of 8 mm."""
    tilt = 0.16
    foot, normal = (0.1e-3, at, tilt * at - DIP), (0.0, -tilt, math.sqrt(1.0 - tilt * tilt))
    count = spread(patch, foot, normal, (0.0, 0.0, -1.0))
    points = patch.vertices[patch.nodes[:count]]
    wide = bool((np.sum((points - foot) ** 2, axis=1) > patch.radius**2).any())
    return float(patch.weights[:count] @ points[:, 1]), wide


def test_the_patch_of_a_foot_that_leaves_a_groove_moves_at_an_even_rate():
    """As it is widened less and less, its centre moves at a rate that changes by at most 0.55/mm. With the smaller of
    h_j² and d_0² that was 0.8/mm, as d_0² passed the heights of the nodes."""
    x, y = np.meshgrid(np.arange(-15e-3, 15e-3, 0.6e-3), np.arange(0.0, 24e-3, 0.6e-3))
    size, points = x.shape, np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    corner = np.arange(x.size).reshape(size)[:-1, :-1].ravel()
    first, second = [corner, corner + 1, corner + size[1]], [corner + 1, corner + size[1] + 1, corner + size[1]]
    triangles = np.concatenate([np.stack(each, axis=1) for each in (first, second)]).astype(np.int32)
    patch = spreader(Mesh(points, triangles), 8e-3)
    centres, widened = zip(*(centre_of(patch, float(at)) for at in np.arange(-1e-3, 2e-3, STEP)), strict=True)
    rate = np.diff(centres) / STEP
    assert any(widened) and not all(widened)
    assert np.abs(np.diff(rate)).max() < 0.55 * 1e3 * STEP
