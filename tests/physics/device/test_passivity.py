"""Bounds of the sampled wall compared with closed forms, a simulated stability limit and published values; force
limits."""

import numpy as np
import pytest
from formulas import delayed_damping, wall_damping
from pytest import approx
from scipy.linalg import expm

from palpate.physics.device.passivity import absorbed_energy, clamp, dissipation, slew
from palpate.physics.device.stability import passive_stiffness

T = 1e-3


def test_the_general_formula_gives_the_closed_bound_without_delay():
    for stiffness, damping in [(500.0, 0.0), (500.0, 5.0), (500.0, -0.1), (10.0, 2.0), (0.0, 0.0)]:
        drag = wall_damping(stiffness, damping, T) + 1e-12  # slightly more, as rounding may exceed the bound of B alone
        assert passive_stiffness(damping, drag, T) == approx(stiffness, rel=1e-6, abs=1e-6)
    assert wall_damping(500.0, 5.0, T) == wall_damping(500.0, -5.0, T) == 5.25


@pytest.mark.parametrize(("delay", "expected"), [(0, 0.25), (1, 0.75), (2, 1.25), (5, 2.75)])
def test_each_sample_of_delay_requires_a_damping_of_stiffness_times_period(delay, expected):
    assert delayed_damping(500.0, T, delay) == approx(expected)
    assert passive_stiffness(0.0, expected, T, delay) == approx(500.0, rel=1e-6)


def test_a_filter_on_the_damping_helps_without_delay_and_hurts_with_it():
    assert passive_stiffness(5.0, 5.25, T) == approx(500.0, rel=1e-6)
    low, high = 500.0 - 0.005 / (0.5 * T), 500.0 + 0.005 / (0.5 * T)  # for published drags within 0.005 N s/m
    assert low < passive_stiffness(5.0, 1.73, T, order=8) < high
    assert low < passive_stiffness(5.0, 2.87, T, delay=1, order=8) < high


@pytest.mark.parametrize("mass", [0.1, 0.3])
@pytest.mark.parametrize("delay", [0, 1, 2, 5])
def test_the_loop_becomes_unstable_within_1_percent_of_the_bound(mass, delay):
    b = 0.5
    limit = 2.0 * b / (T * (1 + 2 * delay))

    def radius(stiffness):
        block = expm(np.array([[0.0, 1.0, 0.0], [0.0, -b / mass, 1.0 / mass], [0.0, 0.0, 0.0]]) * T)
        size = 2 + delay
        loop = np.zeros((size, size))  # x, v, and the delayed forces
        loop[:2, :2] = block[:2, :2]
        loop[:2, -1] += block[:2, 2] if delay else 0.0
        if delay:
            loop[2, 0] = -stiffness
            for i in range(3, size):
                loop[i, i - 1] = 1.0
        else:
            loop[:2, 0] += -stiffness * block[:2, 2]
        return np.abs(np.linalg.eigvals(loop)).max()

    assert radius(0.99 * limit) < 1.0 < radius(1.01 * limit)


def test_a_wall_at_the_bound_requires_the_whole_drag():
    """The bound on b by the printed formula of Colgate & Schenkel, over 200000 frequencies."""
    angle = np.linspace(1e-3, np.pi, 200_000)
    back = np.exp(-1j * angle)
    for delay, damping in ((0, 0.5), (1, 0.5), (2, 1.0), (4, 1.5)):
        stiffness = passive_stiffness(damping, 6.0, T, delay, 2)
        wall = back**delay * (stiffness + damping * (1.0 - back**2) / (2 * T))
        needed = T / 2 * ((1.0 - back) * wall).real / (1.0 - np.cos(angle))
        assert stiffness > 0.0 and needed.max() == approx(6.0, rel=1e-6)


def test_energy_of_a_held_force_is_exact():
    rng = np.random.default_rng(0)
    energy = 0.0
    place, force = np.zeros(3), np.zeros(3)
    supplied = 0.0
    for _ in range(100):
        way = rng.normal(size=3)
        energy = absorbed_energy(energy, *force, *way)
        supplied -= force @ way
        place, force = place + way, rng.normal(size=3)
    assert energy == approx(supplied, rel=1e-12)


def test_the_damper_dissipates_the_debt_in_one_step():
    alpha = dissipation(-1e-5, T, 0.04, 10.0)
    assert alpha * 0.04 * T == approx(1e-5)
    assert dissipation(-1.0, T, 0.04, 0.1) == approx(0.1 / T)
    for slow in (1e-320, 5e-324):  # times T it underflows to 0
        assert dissipation(-1.0, T, slow, 0.1) == approx(0.1 / T)
    for quiet in [(0.0, T, 1.0), (0.5, T, 1.0), (1.0, T, 1.0), (-1.0, 0.0, 1.0), (-1.0, -T, 1.0), (-1.0, T, 0.0)]:
        assert dissipation(*quiet, 0.1) == 0.0


def test_the_force_limit_keeps_the_direction():
    rng = np.random.default_rng(1)
    for size in (1e-3, 8.9, 9.1, 1e3, 1e200, 1e300):
        wish = rng.normal(size=3)
        wish *= size / np.linalg.norm(wish)
        clamped = np.array(clamp(*wish, 9.0))
        assert np.linalg.norm(clamped) == approx(min(size, 9.0), rel=1e-12)
        assert np.cross(clamped / np.linalg.norm(clamped), wish / size) == approx(np.zeros(3), abs=1e-12)
    assert clamp(0.0, 0.0, 0.0, 9.0) == (0.0, 0.0, 0.0)
    assert clamp(np.nan, 0.0, 0.0, 9.0) == (0.0, 0.0, 0.0)
    assert clamp(np.inf, 1.0, 0.0, 9.0) == (0.0, 0.0, 0.0)


def test_the_slew_limit_moves_straight_to_the_target():
    assert slew(3.0, 4.0, 0.0, 0.0, 0.0, 0.0, 1.0) == approx((0.6, 0.8, 0.0))
    assert slew(3.0, 4.0, 0.0, 2.5, 4.0, 0.0, 1.0) == approx((3.0, 4.0, 0.0))
    assert slew(3.0, 4.0, 0.0, 1.0, 1.0, 1.0, 0.0) == approx((1.0, 1.0, 1.0))


@pytest.mark.parametrize("axis", range(3))
def test_a_force_approaches_its_target_by_the_slew_step_and_then_equals_it(axis):
    before, wanted = np.array([0.3, -0.2, 0.5]), np.array([0.3, -0.2, 0.5])
    wanted[axis] += 2.0
    step = np.zeros(3)
    step[axis] = 0.5
    assert slew(*wanted, *before, 0.5) == approx(before + step)
    assert slew(*wanted, *before, 3.0) == approx(wanted)
