"""Kernels of physics.exact against Python's own functions."""

import math

import numpy as np

from palpate.physics.exact import hypot


def test_hypot_is_to_the_bit_that_of_python():
    rng = np.random.default_rng(3)
    for spread in (0, 3, 30, 250):
        for x, y, z in rng.uniform(-1, 1, (3000, 3)) * 10.0 ** rng.uniform(-spread, spread, (3000, 3)):
            assert hypot(x, y, z) == math.hypot(x, y, z)
    for x, y, z in [(0.0, -0.0, 0.0), (1e308, 1e308, 1e308), (3.0, 0.0, 4.0), (math.inf, 0.0, 1.0)]:
        assert hypot(x, y, z) == math.hypot(x, y, z)
    assert math.isnan(hypot(0.0, math.nan, 0.0)) and 0.0 < hypot(1e-310, 0.0, 0.0) < 1e-300
