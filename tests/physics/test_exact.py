"""Sums in kernels have the bits of numpy's and of Python's."""

import math

import numpy as np
import pytest

from palpate.physics.exact import distance, hypot, product, row_times, sum_of_squares


def test_hypot_is_to_the_bit_that_of_python():
    rng = np.random.default_rng(3)
    for spread in (0, 3, 30, 250):
        for x, y, z in rng.uniform(-1, 1, (3000, 3)) * 10.0 ** rng.uniform(-spread, spread, (3000, 3)):
            assert hypot(x, y, z) == math.hypot(x, y, z)
    for x, y, z in [(0.0, -0.0, 0.0), (1e308, 1e308, 1e308), (3.0, 0.0, 4.0), (math.inf, 0.0, 1.0)]:
        assert hypot(x, y, z) == math.hypot(x, y, z)
    assert math.isnan(hypot(0.0, math.nan, 0.0)) and 0.0 < hypot(1e-310, 0.0, 0.0) < 1e-300


@pytest.mark.parametrize("count", range(1, 17))
def test_a_row_times_a_vector_is_as_in_the_product(count):
    rng = np.random.default_rng(count)
    matrix, x = rng.normal(size=(50, count)), rng.normal(size=count)
    assert [row_times(row, x) for row in matrix] == product(matrix, x).tolist()


def test_squares_are_summed_as_numpy_does():
    rng = np.random.default_rng(0)
    for count in (1, 2, 7, 8, 9, 15, 16, 80, 127, 128, 129, 136, 200, 256):
        x = rng.normal(size=count)
        assert sum_of_squares(x) == np.sum(x * x)


def test_the_distance_of_points_is_that_of_the_standard_library():
    rng = np.random.default_rng(1)
    for k in range(2000):
        a = rng.normal(size=3) * 10.0 ** rng.integers(-9, 3)
        b = a + rng.normal(size=3) * 10.0 ** rng.integers(-9, 3) * (k % 50 > 0)
        assert distance(tuple(a.tolist()), b) == math.dist(a, b)
