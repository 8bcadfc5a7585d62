"""Touches and their references, computed by methods that share no code with the tested ones."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy import reference
from palpate.studies.accuracy.cases import TOUCHES, BenchCase, choose_cases
from palpate.studies.accuracy.sites import load_reference
from palpate.studies.peers.continuum import POISSON, RADIUS, YOUNG

B, M = 26.2641, 1681.06
"""[N/m], [1/m] of the exponential fingertip."""
LEVELS = np.array([0.1, 0.3, 0.6, 1.0, 1.5])


def relaxing(tau, hold=1.0):
    return BenchCase("t", "", "slab", "soft", ((0, 0, 0), (0.2, 4e-3, 0), (0.2 + hold, 4e-3, 0)), "middle", tau)


@pytest.mark.parametrize("touch", TOUCHES.values(), ids=lambda touch: touch.name)
def test_the_velocity_of_a_touch_is_the_derivative_of_its_position(touch):
    times = np.linspace(0.0, touch.duration, 20001)
    approach, rate, place, slip = touch.at(times)
    assert np.allclose(np.gradient(approach, times)[1:-1], rate[1:-1], atol=2e-3 * np.abs(rate).max())
    assert np.allclose(np.gradient(place, times)[1:-1], slip[1:-1], atol=2e-3 * max(np.abs(slip).max(), 1e-9))
    assert (approach[0], place[0]) == touch.knots[0][1:]


def test_an_unknown_touch_is_an_error_with_the_list_of_touches():
    with pytest.raises(ArgumentError, match="expected one of ball, plate"):
        choose_cases(["rub"])


def test_a_held_touch_converges_to_the_static_split_of_finger_and_body():
    stiffness = 280.0
    force, depth, _ = reference.in_time(relaxing(0.0), LEVELS, LEVELS / stiffness)
    static = brentq(lambda f: np.log1p(M * f / B) / M + f / stiffness - 4e-3, 1e-6, 3.0, xtol=1e-14)
    assert force[-1] == pytest.approx(static, rel=1e-9)
    assert depth[-1] == pytest.approx(static / stiffness, rel=1e-9)


def test_a_viscous_slab_relaxes_to_the_elastic_one_at_the_rate_of_the_linear_system():
    """Near equilibrium the force decays as exp(-r t), with the rate of the linearized system."""
    stiffness, tau = 280.0, 0.05
    force, *_ = reference.in_time(relaxing(tau), LEVELS, LEVELS / stiffness)
    slack, *_ = reference.in_time(relaxing(0.0), LEVELS, LEVELS / stiffness)
    rest = force[-1]
    assert rest == pytest.approx(slack[-1], rel=1e-6)
    s1 = np.log1p(M * rest / B) / M
    finger, damping = B * np.exp(M * s1), 8.0 * rest
    # tau k s' + k s = f = g + c g s1' with s1' = -s': (tau k + c g) s' = -(k + g') (s - rest)
    rate = (stiffness + finger) / (tau * stiffness + damping)
    at = (np.array([0.45, 0.47]) * reference.RATE).astype(int)
    seen = np.log((force[at[0]] - rest) / (force[at[1]] - rest)) / 0.02
    assert seen == pytest.approx(rate, rel=0.02)


def test_the_reference_in_time_is_of_first_order_before_extrapolation():
    touch = relaxing(0.02, hold=0.05)
    force = [reference.in_time(touch, LEVELS, LEVELS / 280.0, every)[0] for every in (8, 16, 32)]
    coarse, fine = (np.abs(force[k][:: 4 >> k] - force[k + 1][:: 2 >> k]).max() for k in (1, 0))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


def test_an_elastic_slab_returns_its_energy_and_a_viscous_one_does_not():
    elastic, viscous = (reference.reference_solution(TOUCHES[name]).values["energy"] for name in ("edge", "hold"))
    assert abs(elastic[-1]) < 1e-3 * elastic.max()
    assert viscous[-1] > 0.02 * viscous.max()


def test_the_force_of_the_ball_is_the_derivative_of_its_energy():
    right = reference.reference_solution(TOUCHES["ball"])
    depth, force, energy = (right.values[n] for n in ("indentation", "force", "energy"))
    top = int(np.argmax(depth))
    own, _ = quad(lambda s: np.interp(s, depth[:top], force[:top]), 0.0, depth[top], limit=200)
    assert energy[top] == pytest.approx(own, rel=1e-4)


def test_the_surface_displacement_under_a_ball_is_smooth_at_the_rim_and_that_of_a_point_force_far_away():
    depth = 5e-4
    a = np.sqrt(RADIUS * depth)
    rim = reference._hertz_shape(np.array([a * (1 - 1e-6), a * (1 + 1e-6)]), depth)
    assert rim[0] == pytest.approx(rim[1], rel=1e-4)
    assert rim[0] == pytest.approx(depth / 2, rel=1e-4)
    far = 30 * a
    force = reference.HERTZ * depth**1.5
    point = force * (1 - POISSON**2) / (np.pi * YOUNG * far)
    assert reference._hertz_shape(np.array([far]), depth)[0] == pytest.approx(point, rel=2e-3)


def test_the_mean_displacement_of_the_slab_weighted_with_the_pressure_is_the_indentation():
    place = load_reference("middle")
    depth_at = reference.SurfaceShape(place.force, place.x, place.y, place.shape)
    at, weight = np.polynomial.legendre.leggauss(24)
    r, w = RADIUS * (at + 1) / 2, RADIUS * weight / 2
    angles = np.pi * (np.arange(12) + 0.5) / 12
    for force, depth in zip(place.force[[2, 5]], place.indentation[[2, 5]], strict=True):
        shape = np.mean([depth_at(np.stack([r * np.cos(p), r * np.sin(p)], axis=1), force) for p in angles], axis=0)
        mean = np.sum(w * 2 * np.pi * r * 3 / (np.pi * RADIUS**2) * (1 - (r / RADIUS) ** 2) ** 2 * shape)
        assert mean == pytest.approx(depth, rel=5e-3)
