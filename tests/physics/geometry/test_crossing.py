"""Self-intersections of a mesh: contact alone is not one, for any rotation and position."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from palpate.physics.geometry.topology import crossing


def flat(rng):
    places = rng.random((40, 2))
    return np.column_stack([places, np.zeros(40)]), Delaunay(places).simplices


@pytest.mark.parametrize("offset", [0.0, 1.0, 1e3])
def test_a_flat_face_does_not_intersect_itself_at_any_rotation(offset):
    """Rounding moves its triangles slightly above and below one another."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        points, triangles = flat(rng)
        turned = Rotation.random(random_state=seed).apply(points) + offset * rng.normal(size=3)
        assert crossing(turned, triangles) is None


@pytest.mark.parametrize("offset", [0.0, 1.0, 1e3])
def test_a_needle_through_a_flat_face_is_found_at_its_position(offset):
    for seed in range(100):
        rng = np.random.default_rng(seed)
        points, triangles = flat(rng)
        where = points[triangles[0]].mean(axis=0)
        needle = where + np.array([[0, 0, 1e-3], [1e-4, 0, -1e-3], [0, 1e-4, -1e-3]])
        both = np.concatenate([points, needle]), np.concatenate([triangles, [[40, 41, 42]]])
        turn, shift = Rotation.random(random_state=seed), offset * rng.normal(size=3)
        first, second, at = crossing(turn.apply(both[0]) + shift, both[1])
        assert {len(triangles)} < {first, second}
        assert turn.inv().apply(at - shift) == pytest.approx(where, abs=1e-4)


def test_an_unused_vertex_does_not_matter():
    points, triangles = flat(np.random.default_rng(0))
    needle = np.array([[0.4, 0.5, 1e-2], [0.41, 0.5, -1e-2], [0.4, 0.51, -1e-2], [np.nan] * 3])
    assert crossing(np.concatenate([points, needle]), np.concatenate([triangles, [[40, 41, 42]]])) is not None
