"""Normals that are made even: a constant curvature stays, unevenness from vertex to vertex does not."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from palpate.physics.geometry.felt.even import even_normals

REACH, RADIUS = 0.8e-3, 40e-3  # [m]


@pytest.fixture
def cap():
    """Points, normals and triangles of the top of a sphere; half of it has four times as many vertices."""
    rng = np.random.default_rng(3)
    few, many = rng.uniform(-4e-3, 4e-3, (1500, 2)), rng.uniform((0.0, -4e-3), 4e-3, (3000, 2))
    plane = np.concatenate([few, many])
    points = np.column_stack([plane, np.sqrt(RADIUS**2 - (plane**2).sum(axis=1))])
    return points, points / RADIUS, Delaunay(plane).simplices


def test_a_sphere_keeps_its_normals(cap):
    points, normals, triangles = cap
    inner = np.linalg.norm(points[:, :2], axis=1) < 3e-3
    found = even_normals(points, normals, triangles, np.full(len(points), REACH), np.ones(len(points)))
    assert np.abs(found - normals)[inner].max() < 0.1 * (REACH / RADIUS) ** 2
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_unevenness_is_averaged_by_the_share_that_is_given(cap, share):
    points, normals, triangles = cap
    rough = normals + np.random.default_rng(4).normal(scale=1e-3, size=normals.shape)
    rough /= np.linalg.norm(rough, axis=1)[:, None]
    found = even_normals(points, rough, triangles, np.full(len(points), REACH), np.full(len(points), share))
    inner = np.linalg.norm(points[:, :2], axis=1) < 3e-3
    left = (found - normals)[inner].std() / (rough - normals)[inner].std()
    assert 1.0 - share <= left + 1e-12 and left < 1.0 - 0.65 * share + 1e-12
    if share == 0.0:
        assert (found == rough).all()


def test_normals_of_another_side_do_not_count(cap):
    points, normals, triangles = cap
    side = points[:, 0] < 0.0
    bent = np.where(side[:, None], normals, np.array([0.8, 0.0, 0.6]))
    found = even_normals(points, bent, triangles, np.full(len(points), REACH), np.ones(len(points)))
    np.testing.assert_allclose(found[~side], bent[~side], atol=1e-12)
