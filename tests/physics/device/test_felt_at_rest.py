"""A hand presses a law through the controller alone: at rest it feels all of a soft law, and rests on a steep one."""

import math

import numpy as np
import pytest
from pytest import approx

from palpate.compiler.fields import blank_record
from palpate.physics.device.controller import GAINS, STATE, haptic, rings
from palpate.physics.device.observer import AXIS, begin, follow
from palpate.physics.device.rendered import LEAP

MASS, DRAG, COUNT = 0.1, 0.2, 60e-6  # of the device
FINE = 5e-5  # [s] of the integration of the motion
VISCOSITY = 8.0  # [s/m] of a fingertip: f = g(s) (1 + 8 s')
STIFF_HAND, LIGHT_HAND = (0.2, 1000.0, 16.0), (0.15, 600.0, 7.0)  # [kg] with the device, [N/m], [N s/m]
RATES = [1000.0, 2000.0, 10_000.0]


def smooth(u):
    """From 0 to 1 with the least jerk."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)


def press(law, rate, resolution, hand, targets, times, duration=0.55):
    """Contact force and force on the hand [N], and absorbed energy [J], each (k), of a press on g(s) = law(s): the
    spring of the hand is moved from the surface to two `targets` [m], each within its time [s], and rests there."""
    gains = blank_record(
        GAINS, hysteresis=COUNT, mass=MASS, drag=DRAG, limit=9.0, slew=5000.0, resolution=resolution, observes=True,
        passive=True,
    )  # fmt: skip
    state, past, axis = blank_record(STATE), rings(0), blank_record(AXIS)
    begin(axis, 0.0)
    mass, stiffness, damping = hand
    parts, step = round(1.0 / (rate * FINE)), 1.0 / rate
    dt = step / parts
    t = np.arange(round(duration * rate) * parts) * dt
    goals = targets[0] * smooth(t / times[0]) + (targets[1] - targets[0]) * smooth((t - times[0]) / times[1])
    x = v = force = energy = place = 0.0
    rows = []
    for k, (goal, speed) in enumerate(zip(goals, np.gradient(goals, dt), strict=True)):
        v += (stiffness * (goal - x) + damping * (speed - v) - DRAG * v - force) / mass * dt
        x += v * dt
        energy += force * v * dt
        if (k + 1) % parts:
            continue
        before, counted = place, COUNT * math.floor(x / COUNT + 0.5)
        place = follow(axis, counted, COUNT, step) if resolution > 0.0 else x
        depth = max(place, 0.0)
        contact = max(law(depth) * (1.0 + VISCOSITY * (depth - max(before, 0.0)) / step), 0.0)
        at, velocity = (0.0, 0.0, -place), (0.0, 0.0, (before - place) / step)
        force = haptic(gains, state, past, contact, (0, 0, 1.0), (0, 0, 0.0), depth, depth, at, velocity, step)[2]
        rows.append((contact, force, energy))
    return np.array(rows).T


@pytest.mark.parametrize("resolution", [0.0, COUNT])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("law", [lambda s: 600.0 * s, lambda s: 8000.0 * s**1.5], ids=["linear", "power"])
@pytest.mark.parametrize(
    ("targets", "times"), [((7e-3, 5e-3), (0.06, 0.03)), ((5e-3, 3.5e-3), (0.08, 0.04)), ((7e-3, 5e-3), (0.08, 0.04))]
)
def test_a_hand_at_rest_after_a_fast_retreat_feels_a_soft_law(law, rate, resolution, targets, times):
    """In the retreat the viscous force falls as steeply as a law of more than 1667 N/m; of up to 2.2 N the hand lacked
    0.8 N for the whole hold."""
    contact, felt, energy = (each[-round(0.1 * rate) :] for each in press(
        law, rate, resolution, STIFF_HAND, targets, times
    ))  # fmt: skip
    assert contact.mean() > 0.9
    assert felt.mean() == approx(contact.mean(), rel=0.05, abs=0.05)
    assert felt.std() < 0.01 and np.ptp(energy) < 0.1e-3


@pytest.mark.parametrize("resolution", [0.0, COUNT])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("steep", [3e3, 10e3, 60e3])
@pytest.mark.parametrize("times", [(0.08, 0.04), (0.05, 0.02)])
def test_a_hand_rests_on_a_law_that_is_soft_first_and_then_steep(steep, rate, resolution, times):
    """A line that returned to it would push the hand out of it, with 0.1 to 0.7 N to and fro at 500 N/m and these."""

    def law(s):
        return 500.0 * s + steep * max(s - 2e-3, 0.0)

    contact, felt, energy = press(law, rate, resolution, LIGHT_HAND, (2.3e-3, 5.2e-3), times)
    assert energy.min() > -0.1e-3
    n = round(0.15 * rate)
    held = -energy[-n:]
    assert felt[-n:].std() < 0.02 and (held - np.minimum.accumulate(held)).max() < 0.3e-3
    assert 1.0 < felt[-n:].mean() < 3.0
    if resolution > 0.0 and steep > 2.0 * LEAP / resolution:
        assert contact[-n:].mean() > 1.3 * felt[-n:].mean(), "a force that this device cannot render"
