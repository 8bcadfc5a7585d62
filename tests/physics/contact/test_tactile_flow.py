"""Tactile flow compared with closed forms and brute force."""

from fractions import Fraction
from math import prod

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pytest import approx
from scipy.linalg import expm

from palpate.physics.contact.tactile import (
    equivalent_strain,
    growth,
    isostrain_volume,
    stick_radius,
    tactile_flow,
)


def test_equivalent_strain_is_right_for_simple_states():
    assert equivalent_strain(1.1 * np.eye(3)) == approx(0.0, abs=1e-15)
    nu = 0.3
    assert equivalent_strain(np.diag(np.exp([0.02, -nu * 0.02, -nu * 0.02])), nu) == approx(0.02)
    shear = np.array([[0, 0.05, 0], [0.05, 0, 0], [0, 0, 0]])
    assert equivalent_strain(expm(shear), 0.5) == approx(0.1 / np.sqrt(3))


def test_rigid_motion_has_no_strain():
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((5, 3, 3)))
    turn *= np.sign(np.linalg.det(turn))[:, None, None]
    assert equivalent_strain(turn) == approx(0.0, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(arrays(float, 4, elements=st.integers(0, 4).map(float)), st.floats(-0.5, 4.5))
def test_a_clipped_tetrahedron_has_the_exact_volume(values, level):
    """Repeated corner values are the hard cases, compared with the exact integral over slices of distinct values."""
    apart = values + 1e-4 * np.array([0.0, 1.0, 2.0, 3.0])
    v, c = [Fraction(x) for x in apart], Fraction(level)
    terms = [max(v[i] - c, 0) ** 3 / prod(v[i] - v[j] for j in range(4) if j != i) for i in range(4)]
    exact = float(sum(terms))
    assert isostrain_volume(apart[None], [2.0], [level])[0] == approx(2.0 * exact, abs=1e-9)
    if np.abs(values - level).min() > 1e-2:
        assert isostrain_volume(values[None], [1.0], [level])[0] == approx(exact, abs=2e-2)


def test_volumes_decrease_with_the_level_and_add_up():
    rng = np.random.default_rng(1)
    values, volumes = rng.random((50, 4)), rng.random(50)
    above = isostrain_volume(values, volumes, np.linspace(-0.1, 1.1, 30))
    assert above[0] == approx(volumes.sum()) and above[-1] == 0.0
    assert (np.diff(above) <= 1e-12).all()
    assert (isostrain_volume(values + 0.01, volumes, [0.5]) >= isostrain_volume(values, volumes, [0.5])).all()


def test_the_volume_of_a_ball_converges_with_second_order():
    from palpate.models.fe.element.mesh import bricks, grid

    errors = []
    for count in (6, 12):
        x = np.linspace(-1, 1, count + 1)
        points, cells = grid(x, x, x)
        tets = bricks(points, cells)
        corner = points[tets]
        volumes = np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6
        volume = isostrain_volume(-np.linalg.norm(corner, axis=2), volumes, [-0.8])[0]
        errors.append(abs(volume / (4 / 3 * np.pi * 0.8**3) - 1))
    assert errors[1] < 0.03 and errors[1] < errors[0] / 3


def test_the_flow_is_the_velocity_of_a_moving_front():
    """e = r0(P) - r moves outwards at dr0/dP along -grad e."""
    rng = np.random.default_rng(2)
    turn, _ = np.linalg.qr(rng.standard_normal((20, 3, 3)))
    corners = np.array([2.0, 0.0, 0.0]) + 0.01 * np.concatenate([0 * turn[:, :1], turn], axis=1)

    def strain(force):
        return 1.0 + 3.0 * force - np.linalg.norm(corners, axis=2)

    flow = tactile_flow(corners, strain(0.1), strain(0.2), 0.1, 0.2)
    assert flow == approx(np.tile([3.0, 0, 0], (20, 1)), abs=0.05)
    still = tactile_flow(corners, 0 * strain(0.1), 0 * strain(0.1), 0.1, 0.2)
    assert (still == 0.0).all()
    with pytest.raises(ValueError, match="equal forces"):
        growth(1.0, 2.0, 0.3, 0.3)


def test_the_stick_radius_shrinks_to_zero():
    assert stick_radius(2e-3, 0.0, 1.0, 0.2) == 2e-3
    assert stick_radius(2e-3, 0.1, 1.0, 0.2) == approx(2e-3 * 0.5 ** (1 / 3))
    assert stick_radius(2e-3, 0.3, 1.0, 0.2) == 0.0 == stick_radius(2e-3, 0.0, 0.0, 0.2)
