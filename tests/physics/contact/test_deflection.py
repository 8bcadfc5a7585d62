"""Displacement of the surface of a half-space under a patch: closed forms, the sum over points, reciprocity."""

import math

import numpy as np
import pytest
from pytest import approx

from palpate.physics.contact.deflection import surface_under_patch
from palpate.physics.contact.spread import KERNELS, kernel_values

R, NU = 8e-3, 0.3
INSIDE = R * np.array([(0.0, 0.0), (0.3, 0.0), (0.1, -0.6), (-0.7, 0.5)])


def test_under_hertz_pressure_the_surface_is_that_of_a_ball():
    """K. L. Johnson, Contact Mechanics, eq. 3.41a: E* u_z = pi p0 (2 a² - r²)/(4 a)."""
    p0 = 3.0 / (2.0 * math.pi * R**2)
    r2 = np.sum(INSIDE**2, axis=1)
    assert surface_under_patch(INSIDE, R, "hertz", NU)[:, 2, 2] == approx(
        math.pi * p0 * (2 * R * R - r2) / (4 * R), rel=2e-4
    )


def test_under_tangential_hertz_traction_the_surface_moves_as_in_the_closed_form():
    """Johnson, eq. 3.91: u_x = pi q0 (4 (2 - nu) a² - (4 - 3 nu) x² - (4 - nu) y²)/(32 G a), u_y = pi q0 2 nu x y/(32 G
    a); E*/G = 2/(1 - nu)."""
    x, y = INSIDE.T
    scale = math.pi * 3.0 / (2.0 * math.pi * R**2) / (32.0 * R) * 2.0 / (1.0 - NU)
    found = surface_under_patch(INSIDE, R, "hertz", NU)
    right = scale * (4 * (2 - NU) * R**2 - (4 - 3 * NU) * x**2 - (4 - NU) * y**2)
    assert found[:, 0, 0] == approx(right, rel=3e-4)
    assert found[:, 1, 0] == approx(scale * 2 * NU * x * y, abs=3e-4 * right.max())


@pytest.mark.parametrize("poisson", [0.3, 0.45])
def test_below_the_middle_of_a_biweight_patch(poisson):
    """E* u_z = 2 int p dr = 16 f/(5 pi R)."""
    found = surface_under_patch(np.zeros((1, 2)), R, "biweight", poisson)[0]
    assert found[2, 2] == approx(16.0 / (5.0 * math.pi * R), rel=1e-9)
    assert found[0, 0] / found[2, 2] == approx((1 - poisson / 2) / (1 - poisson), rel=1e-9)


@pytest.mark.parametrize("kernel", KERNELS)
def test_it_equals_the_sum_over_the_points_of_a_grid(kernel):
    """Of the point forces, at points between those of a grid of R/100, and far outside."""
    line = R * (np.arange(-100, 100) + 0.5) / 100
    source = np.stack(np.meshgrid(line, line, indexing="ij"), -1).reshape(-1, 2)
    share = kernel_values(kernel, np.minimum(np.hypot(*source.T) / R, 1.0))
    share /= share.sum()
    at = R * np.array([(0.2, 0.4), (0.0, -0.8), (1.2, 0.9)])
    found = surface_under_patch(at, R, kernel, NU)
    for point, got in zip(at, found, strict=True):
        x, y = (point - source).T
        r = np.hypot(x, y)
        k = (1 - 2 * NU) / (2 * math.pi * (1 - NU))
        right = np.array([
            [(1 / r + NU / (1 - NU) * x * x / r**3) / math.pi, NU / (1 - NU) * x * y / r**3 / math.pi, -k * x / r**2],
            [NU / (1 - NU) * x * y / r**3 / math.pi, (1 / r + NU / (1 - NU) * y * y / r**3) / math.pi, -k * y / r**2],
            [k * x / r**2, k * y / r**2, 1 / (math.pi * r)],
        ]) @ share  # fmt: skip
        assert got == approx(right, abs=0.01 * right.max())


def test_forces_and_displacements_are_reciprocal_for_a_small_patch():
    """Betti: the displacement along a at B per force along b at A equals that along b at A per force along a at B."""
    a = surface_under_patch(np.array([(5e-3, 2e-3)]), 1e-5, "biweight", NU)[0]
    b = surface_under_patch(np.array([(-5e-3, -2e-3)]), 1e-5, "biweight", NU)[0]
    assert a == approx(b.T, rel=1e-4)
