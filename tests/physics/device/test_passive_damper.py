"""The damper that dissipates observed generated energy: its bounds, computed by hand for each delay and path."""

import numpy as np
import pytest
from pytest import approx

from palpate.compiler.fields import blank_record
from palpate.physics.device.controller import GAINS, STATE, haptic, rings

T, MASS, COUNT = 1e-3, 0.2, 1e-5  # [s], [kg], [m] of an encoder


def passive(observes=True, **more):
    """Gains without a spring, a damper and limits."""
    return blank_record(GAINS, mass=MASS, limit=1e9, slew=1e9, observes=observes, passive=True, **more)


def damper(delay, way, velocity, debt=-1.0, axis=0, last=0.0, turned=False):
    """Force [N] on a hand in free motion with generated energy `debt` [J], after a path [m] per step along an axis,
    without a spring.

    last    [N] of the damping in the step before
    turned  whether the motion was in the other direction then
    """
    gains = passive(hysteresis=1e-3, resolution=COUNT)
    state, past = blank_record(STATE), rings(delay)
    rest, up, along = np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3)[axis]
    haptic(gains, state, past, 0.0, up, rest, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), T)
    state.energy = debt
    state.brake[axis] = last if turned else -last
    # Twice the path, because the time of the first step, without movement, also counts.
    force = haptic(gains, state, past, 0.0, up, rest, 0.0, 0.0, tuple(2 * way * along), tuple(velocity * along), T)[:3]
    assert force[axis - 1] == force[axis - 2] == 0.0
    return force[axis]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("delay", [0, 1, 2, 5])
def test_a_damper_on_the_last_difference_is_bounded_by_the_delay_of_the_loop(delay, axis):
    """A damper with a delay of d samples is stable up to about m / ((1 + 2 d) T); half of it is used."""
    most = 0.5 * MASS / ((1 + 2 * delay) * T) * 20 * COUNT / T
    for last in (most - 0.01, most + 0.01):
        assert damper(delay, 20 * COUNT, 7.0, axis=axis, last=last) == approx(-most)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("delay", [0, 3])
def test_a_path_of_one_count_is_damped_with_the_filtered_velocity(delay, axis):
    """The filter has a delay of four samples, which adds eight half periods."""
    slow, fast = 0.5 * MASS / ((1 + 2 * delay + 8) * T) * 0.003, 0.5 * MASS / ((1 + 2 * delay) * T) * 1.6 * COUNT / T
    for last in (slow - 0.002, slow + 0.002):
        assert damper(delay, COUNT, 0.003, axis=axis, last=last) == approx(-slow)
    assert damper(delay, 1.6 * COUNT, 0.003, last=fast - 0.004) == approx(-fast)


def test_a_filtered_velocity_below_one_count_is_ignored():
    assert damper(0, COUNT, 1.4 * COUNT / (8 * T)) == 0.0
    assert damper(0, COUNT, 1.6 * COUNT / (8 * T)) < 0.0


def test_a_small_debt_is_dissipated_in_one_step_and_without_debt_nothing_is_damped():
    way = 20 * COUNT
    force = damper(0, way, 7.0, debt=-1e-6)
    assert -force * way == approx(1e-6)
    assert damper(0, way, 7.0, debt=0.0) == 0.0


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("delay", [0, 2])
def test_the_damping_changes_over_a_motion_no_faster_than_a_contact(delay, axis):
    assert damper(delay, 20 * COUNT, 0.2, axis=axis) == approx(-4.0), "0.1 N per count"
    assert damper(delay, 20 * COUNT, 0.2, debt=0.0, axis=axis, last=6.0) == approx(-2.0)
    assert damper(delay, 20 * COUNT, 0.2, debt=0.0, axis=axis, last=6.0, turned=True) == 0.0
    assert damper(delay, 0.0, 0.0, axis=axis, last=0.5) == 0.0


def test_the_damping_falls_to_zero_while_it_dissipates_the_rest_of_the_debt():
    """A push against it by a hand that does not yield, 1 mm/step with an exact position."""
    gains, state, past = passive(), blank_record(STATE), rings(0)
    way, up = 2e-5, np.array([0.0, 0.0, 1.0])
    stiffness, forces, start = 0.01 * MASS / (0.5 * T) ** 2, [], -5e-3
    for k in range(200):
        if k == 1:
            state.energy = start
        forces.append(
            haptic(gains, state, past, 0.0, up, np.zeros(3), 0.0, 0.0, (k * way, 0.0, 0.0), (way / T, 0.0, 0.0), T)[0]
        )
    forces = -np.array(forces)
    assert np.abs(np.diff(forces)).max() <= stiffness * way * (1.0 + 1e-9)
    assert forces.max() > 0.3 * np.sqrt(-stiffness * start) and forces[-1] == 0.0
    assert way * forces.sum() == approx(-start, rel=0.05) and way * forces.sum() >= -start * (1.0 - 1e-9)


def test_a_slew_limit_bounds_the_rise_of_the_damper_force():
    """Along a path in space with 2 N/ms; without a debt it falls by 8000 N/m times the path, and later rises again."""
    gains, state, past = passive(), blank_record(STATE), rings(0)
    way, up = np.array([2.0, -3.0, 6.0]) * 1e-4, np.array([0.0, 0.0, 1.0])
    state.rise = 2000.0
    forces = []
    for k, debt in enumerate((0.0, -1.0, -1.0, -1.0, 1.0, -1.0, -1.0)):
        state.energy = debt
        forces.append(
            haptic(gains, state, past, 0.0, up, np.zeros(3), 0.0, 0.0, tuple(k * way), (0.0, 0.0, 0.0), T)[:3]
        )
    assert -np.array(forces) @ way / np.linalg.norm(way) == approx([0.0, 2.0, 4.0, 6.0, 0.4, 2.4, 4.4])
    assert np.cross(forces, way) == approx(0.0, abs=1e-12)


def test_a_slew_limit_gives_no_force_at_rest():
    gains, state, past = passive(observes=False), blank_record(STATE), rings(0)
    state.rise = 2000.0
    still = (0.0, 0.0, 0.0)
    assert haptic(gains, state, past, 0.0, np.eye(3)[2], np.zeros(3), 0.0, 0.0, still, still, T)[:3] == still
