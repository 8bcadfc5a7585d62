"""The nearest points of a k-d tree: in ascending order, of equally far ones those with the lowest indices."""

import numpy as np
import pytest

from palpate.physics.nearest import nearest, tree_of

GRID = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("count", [1, 3, 6])
@pytest.mark.parametrize("most", [np.inf, 0.8])
def test_nearest_points_are_those_of_all_distances(axes, count, most):
    """Places between the points of a grid, where up to eight are equally far, and at random."""
    points = np.unique(GRID[:, :axes], axis=0)
    rng = np.random.default_rng(axes)
    places = np.concatenate(
        [rng.uniform(0, 5, size=(40, axes)), np.round(2.0 * rng.uniform(0, 5, size=(40, axes))) / 2.0]
    )
    away, found = nearest(tree_of(points), places, count, most)
    every = np.linalg.norm(places[:, None] - points, axis=2)
    order = np.argsort(np.round(every, 12), axis=1, kind="stable")[:, :count]
    right = np.take_along_axis(every, order, 1)
    near = right < most
    np.testing.assert_allclose(np.where(near, right, np.inf), away, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(found[near], order[near])
    one, which = nearest(tree_of(points), places[0], count, most)
    np.testing.assert_array_equal(one, away[0])
    assert which.shape == (min(count, len(points)),)
