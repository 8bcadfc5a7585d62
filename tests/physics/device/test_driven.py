"""A hand on tissue that something else moves: the energy that it gets from there is not that of the controller."""

import math

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.compiler.fields import blank_record
from palpate.physics.device.controller import GAINS, STATE, haptic, rings

MASS, DRAG, COUNT = 0.1, 0.2, 60e-6  # of the device
FINE = 5e-5  # [s] of the integration of the motion
STILL = (0.0, 0.0, 0.0)


def rise(t):
    """Height [m] of a surface that rises by 5 mm under the hand, and falls."""
    return 2.5e-3 * (1.0 - math.cos(2.0 * math.pi * t / 0.4)) if t < 0.4 else 0.0


def touch(
    stiffness, rate, resolution, driven, height, hand, begin=0.0, duration=0.5, turn=None, drag=DRAG, observes=True
):
    """Contact force and force on the hand along the normal [N], speed outwards [m/s], and energies [J]: that of the
    controller, and the work of the hand; each (k). A hand (mass [kg], stiffness [N/m], damping [N s/m], place [m])
    holds a finger, first at `begin` [m], above a surface `height(t)` [m] of a `stiffness` [N/m].

    drag   [N s/m]    of the device, as the controller takes it
    observes          whether the controller counts energy
    """
    gains = blank_record(
        GAINS, hysteresis=COUNT, mass=MASS, drag=drag, limit=9.0, slew=5000.0, resolution=resolution, observes=observes,
        passive=True, driven=driven,
    )  # fmt: skip
    state, past, turn = blank_record(STATE), rings(0), np.eye(3) if turn is None else turn
    n = tuple(turn @ (0.0, 0.0, 1.0))
    mass, spring, damping, rest = hand
    parts, step = round(1.0 / (rate * FINE)), 1.0 / rate
    dt, x, v, work = step / parts, begin, 0.0, 0.0
    force, rows = 0.0, []
    for k in range(round(duration * rate) * parts):
        v += (force - spring * (x - rest) - damping * v - DRAG * v) / mass * dt
        x += v * dt
        work -= force * v * dt
        if (k + 1) % parts:
            continue
        place = COUNT * round(x / COUNT) if resolution > 0.0 else x
        depth = max(height((k + 1) * dt) - place, 0.0)
        *shown, _, energy = haptic(
            gains, state, past, stiffness * depth, n, STILL, depth, depth, tuple(place * np.array(n)),
            tuple(v * np.array(n)), step,
        )  # fmt: skip
        force = np.array(shown) @ n
        rows.append((stiffness * depth, force, v, energy, work))
    return np.array(rows).T


SOFT_HAND = (0.2, 300.0, 6.0, 0.0)
"""Rests at the surface before it rises."""


@pytest.mark.parametrize("turned", [None, 5])
@pytest.mark.parametrize("resolution", [0.0, COUNT])
@pytest.mark.parametrize("rate", [1000.0, 4000.0, 10_000.0])
def test_tissue_that_rises_pushes_a_hand_out_as_without_an_observer(rate, resolution, turned):
    """The hand gets 2.2 mJ that it has not put in. Where only the finger moves the tissue this would show a body that
    is not passive, and most of it is withheld."""
    turn = None if turned is None else Rotation.random(random_state=turned).as_matrix()
    contact, force, _, energy, work = touch(600.0, rate, resolution, True, rise, SOFT_HAND, turn=turn)
    _, free, _, _, _ = touch(600.0, rate, resolution, True, rise, SOFT_HAND, turn=turn, observes=False)
    _, alone, _, observed, own = touch(600.0, rate, resolution, False, rise, SOFT_HAND, turn=turn)
    assert contact.max() > 0.9 and work.min() < -2e-3
    count = 600.0 * resolution  # [N]; both hands pass a count in other ticks
    assert np.abs(force - free).max() < 0.02 + 1.5 * count and force.min() > -1e-9
    if resolution == 0.0:
        assert np.abs(force - contact)[contact > 0.0].max() < 0.005, "the lag damps the motion against the surface only"
    assert energy.min() > -5e-6
    assert np.abs(alone - free).max() > 0.06 + count
    assert observed == approx(own, abs=1e-9 if resolution == 0.0 else 0.1e-3)


@pytest.mark.parametrize("resolution", [0.0, COUNT])
@pytest.mark.parametrize("rate", [1000.0, 4000.0])
@pytest.mark.parametrize("stiffness", [1000.0, 2500.0, 8000.0])
def test_energy_that_the_controller_generates_is_withheld_with_another_finger_as_well(stiffness, rate, resolution):
    """The device has a fortieth of the drag that the controller knows, so it renders a wall that is not passive. The
    damping acts as where nothing else can move the wall, to the bit."""
    hand = (0.1, 100.0, 0.0, -3e-3)
    one, other, free = (
        touch(stiffness, rate, resolution, driven, lambda t: 0.0, hand, 1e-3, duration=1.5, drag=8.0, observes=observes)
        for driven, observes in ((False, True), (True, True), (True, False))
    )
    assert np.array_equal(one, other)
    assert np.abs(other[1] - free[1]).max() > 0.03, "the damping acts"


@pytest.mark.parametrize(("stiffness", "rate"), [(1000.0, 4000.0), (1000.0, 10_000.0), (2500.0, 10_000.0)])
def test_with_exact_positions_the_damping_changes_about_as_fast_as_the_contact(stiffness, rate):
    """A heavy hand that throws the finger against a spring, which generates energy by the lag. The largest
    rendered stiffness of 64 to 400 kN/m let the damping change by 9 to 18 times as much as the contact in a tick."""
    contact, force, _, _, work = touch(
        stiffness, rate, 0.0, False, lambda t: 0.0, (0.3, 500.0, 0.0, -2e-3), 1e-3, duration=1.5
    )
    assert -0.02e-3 < work.min() < -2e-6
    assert np.abs(np.diff(force)).max() < 2.1 * np.abs(np.diff(contact)).max()


@pytest.mark.parametrize("rate", [1000.0, 4000.0, 10_000.0])
def test_soft_tissue_that_returns_more_than_it_took_is_damped_as_fast_as_it_pushes(rate):
    """A hand presses by 3 mm and leaves at 0.15 m/s; the tissue takes 1.35 mJ and returns 1.7 mJ. With at least the
    slope b/t of the device's drag and the lag, the force changed in a tick by 5 and 10 times as much as the contact's
    at 4 and 10 kHz."""
    gains = blank_record(
        GAINS, hysteresis=COUNT, mass=MASS, drag=DRAG, limit=9.0, slew=5000.0, observes=True, passive=True
    )
    state, past, deepest, rows = blank_record(STATE), rings(0), 3e-3, []
    for t in np.arange(0.0, 0.06, 1.0 / rate):
        x, leaves = abs(0.15 * t - 4e-3) - deepest, 0.15 * t > 4e-3
        depth = max(-x, 0.0)
        force = 300.0 * depth + (150.0 * min(deepest - depth, depth) if leaves else 0.0)
        *shown, _, energy = haptic(
            gains, state, past, force, (0.0, 0.0, 1.0), STILL, depth, depth, (0.0, 0.0, x),
            (0.0, 0.0, 0.15 if leaves else -0.15), 1.0 / rate,
        )  # fmt: skip
        rows.append((force, shown[2], energy))
    contact, force, energy = np.array(rows).T
    assert energy.min() < -50e-6 and np.abs(force - contact).max() > 0.1, "the damping acts"
    assert np.abs(np.diff(force)).max() < 2.1 * np.abs(np.diff(contact)).max()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("what", ["normal", "friction"])
def test_after_a_number_that_is_not_finite_the_force_returns(what, bad):
    gains = blank_record(
        GAINS, hysteresis=COUNT, mass=MASS, drag=DRAG, limit=9.0, slew=5000.0, observes=True, passive=True, driven=True
    )
    state, past, up = blank_record(STATE), rings(0), (0.0, 0.0, 1.0)
    for k in range(90):
        depth = 5e-5 * min(k, 50)
        wrong = (bad, 0.0, 0.0) if k in (20, 60) else None
        n, rubs = (wrong or up, STILL) if what == "normal" else (up, wrong or STILL)
        *force, _, energy = haptic(
            gains, state, past, 500.0 * depth, n, rubs, depth, depth, (0.0, 0.0, -depth), STILL, 1e-3
        )
        assert np.isfinite(force).all()
    assert math.isfinite(energy) and math.isfinite(state.made)
    assert force[2] == approx(500.0 * depth, abs=0.02)
