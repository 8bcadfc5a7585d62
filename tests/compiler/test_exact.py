"""Sums in kernels are bit-equal to those of numpy and Python."""

import math

import numpy as np
import pytest

from palpate.compiler.exact import distance, hypot, product, row_times, sum_of_squares


@pytest.mark.parametrize("count", range(1, 17))
def test_a_row_times_a_vector_equals_the_matrix_product(count):
    rng = np.random.default_rng(count)
    matrix, x = rng.normal(size=(50, count)), rng.normal(size=count)
    assert [row_times(row, x) for row in matrix] == product(matrix, x).tolist()


def test_squares_are_summed_as_in_numpy():
    rng = np.random.default_rng(0)
    for count in (1, 2, 7, 8, 9, 15, 16, 80, 127, 128, 129, 136, 200, 256):
        x = rng.normal(size=count)
        assert sum_of_squares(x) == np.sum(x * x)


def test_the_distance_of_points_equals_that_of_the_standard_library():
    rng = np.random.default_rng(1)
    for k in range(2000):
        a = rng.normal(size=3) * 10.0 ** rng.integers(-9, 3)
        b = a + rng.normal(size=3) * 10.0 ** rng.integers(-9, 3) * (k % 50 > 0)
        assert distance(tuple(a.tolist()), b) == math.dist(a, b)
        assert hypot(*a.tolist()) == math.hypot(*a.tolist())
    assert hypot(0.0, -0.0, 0.0) == 0.0 and hypot(-3.0, 0.0, 4.0) == 5.0
