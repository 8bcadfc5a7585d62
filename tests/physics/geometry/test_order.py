"""Orders of points and keys, and the lists of corners, against numpy's."""

import numpy as np
import pytest

from palpate.physics.geometry.search.corners import boxes_of, stars
from palpate.physics.geometry.search.morton import morton_order, order_of

RNG = np.random.default_rng(5)


@pytest.mark.parametrize(
    "keys",
    [
        RNG.normal(size=3000),
        np.round(RNG.normal(size=3000), 1),  # -0.0 equals 0.0, and equal keys keep their order
        RNG.normal(size=300) * 10.0 ** RNG.integers(-300, 300, 300),
        RNG.integers(-(2**62), 2**62, 3000),
        RNG.integers(-3, 3, 3000),
        np.zeros(0),
    ],
    ids=["floats", "ties", "sizes", "integers", "few", "none"],
)
def test_keys_are_sorted_as_by_a_stable_sort(keys):
    np.testing.assert_array_equal(order_of(keys), np.argsort(keys, kind="stable"))


def test_points_are_in_the_order_of_their_interleaved_bits():
    points = RNG.uniform(-1.0, 3.0, (2000, 3)) * (1.0, 0.2, 0.5)
    points[::7] = points[0]
    places = ((points - points.min(axis=0)) / np.ptp(points, axis=0).max() * (2**21 - 1)).astype(int)
    codes = [int("".join(f"{z:021b}"[k] + f"{y:021b}"[k] + f"{x:021b}"[k] for k in range(21)), 2) for x, y, z in places]
    np.testing.assert_array_equal(morton_order(points), sorted(range(len(codes)), key=codes.__getitem__))


def test_each_vertex_has_the_list_of_its_triangles_and_each_triangle_its_box():
    triangles, points = RNG.integers(0, 50, (300, 3)).astype(np.int32), RNG.normal(size=(52, 3))
    at, star = stars(triangles, 52)
    for v in range(52):
        corners = np.flatnonzero(triangles.ravel() == v)
        np.testing.assert_array_equal(star[at[v] : at[v + 1]], corners // 3)
    low, high = boxes_of(points, triangles)
    np.testing.assert_array_equal(low, points[triangles].min(axis=1))
    np.testing.assert_array_equal(high, points[triangles].max(axis=1))
