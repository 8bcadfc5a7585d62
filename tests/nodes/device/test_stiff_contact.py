"""Stiff contact in a sampled loop with delay: a mass with drag, under forces held over a step, hits a wall."""

import math

import numpy as np
import pytest
from pytest import approx

from palpate.messages import Contact, Pose
from palpate.nodes.controller import Haptic
from palpate.physics.device.rendered import stiffest

UP = (0.0, 0.0, 1.0)


def meet(stiffness, delay, rate=1000.0, mass=0.1, speed=0.05, push=0.5, seconds=4.0, drag=0.2, stated=None):
    """A grip pushed against a wall at z = 0: its positions [m], forces [N], and the energy [J] absorbed by the display,
    true and reported. m v' = F - push - b v is solved in closed form over each step."""
    node = Haptic(delay=delay if stated is None else stated)
    node.start()
    dt = 1.0 / rate
    keep = math.exp(-drag / mass * dt)
    gain = (1.0 - keep) * mass / drag
    z, v, force, energy, line, rows = 1e-3, -speed, 0.0, 0.0, [1e-3] * (delay + 1), []
    for _ in range(round(seconds * rate)):
        steady = (force - push) / drag
        way = steady * dt + (v - steady) * gain
        v = steady + (v - steady) * keep
        energy -= force * way
        z += way
        line = [z, *line[:-1]]
        depth = max(-line[-1], 0.0)
        contact = Contact(foot=(0.0, 0.0, 0.0), normal=UP, force=stiffness * depth, compression=depth, indentation=0.0,
                          compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
        answer = node.step(contact, None, Pose(position=(0.0, 0.0, line[-1]), velocity=(0.0, 0.0, v), dt=dt), dt=dt)
        force = answer.force[2]
        rows.append((z, force, energy, answer.energy))
    return np.array(rows).T


def swings(z):
    """Peak to peak [m] in each quarter of a record."""
    return [float(np.ptp(part)) for part in np.array_split(z, 4)]


FIRST = ((500.0, 0), (500.0, 5), (1000.0, 0), (1000.0, 1), (1000.0, 3), (1000.0, 5), (2000.0, 1), (4000.0, 5))
"""Rates [Hz] and delays that bound all others."""
LOOPS = [
    pytest.param(rate, delay, marks=() if (rate, delay) in FIRST else pytest.mark.long)
    for rate in (500.0, 1000.0, 2000.0, 4000.0)
    for delay in range(6)
]


@pytest.mark.parametrize(("rate", "delay"), LOOPS)
def test_no_wall_causes_a_lasting_oscillation(rate, delay):
    for stiffness in (500.0, 3e3, 1e5, 1e9):
        for mass, speed in ((0.05, 0.05), (0.1, 0.3), (0.3, 0.15)):
            z, force, energy, _ = meet(stiffness, delay, rate, mass, speed)
            *_, before, last = swings(z)
            assert last <= max(0.9 * before, 0.05e-3), (stiffness, mass, speed, before, last)
            assert np.abs(force).max() <= 9.0 + 1e-9 and energy.min() > -5e-3


def test_a_stiff_wall_with_one_sample_of_delay_generates_little_energy():
    for mass in (0.05, 0.1, 0.3):
        assert meet(1e4, 1, mass=mass, speed=0.0)[2].min() > -2e-3


@pytest.mark.parametrize("delay", [0, 1, 3, 5])
def test_the_reported_energy_is_that_at_the_hand(delay):
    """It is known `delay` samples later, and at a reversal within the force times one position step. At the end of
    contact absorbed energy is reset, so the first press is compared."""
    _, force, energy, reported = meet(300.0, delay, speed=0.1, push=0.5, seconds=0.06)
    assert force.max() > 0.5
    late = energy[: len(energy) - delay]
    assert reported[delay:] - reported[delay] == approx(late - late[0], abs=66e-6 * force.max())


def test_the_stiffest_slope_equals_the_table():
    def kilo(delay, rate=1000.0):
        return stiffest(0.1, 0.2, 0.0, (delay + 0.5) / rate)

    assert [kilo(d) for d in range(6)] == approx([4400, 578, 240, 139, 94, 69], abs=1)
    assert stiffest(0.1, 0.2, 60e-6, 0.125e-3) == approx(0.1 / 60e-6)


def test_a_soft_contact_is_rendered_unchanged():
    """A press with a kidney's slope at 1 kHz without delay: bit-equal during loading, within a few mN during
    unloading."""
    node = Haptic()
    node.start()
    depth = 5e-3 * np.sin(np.linspace(0.0, np.pi, 300)) ** 2
    for before, d in zip(np.append(0.0, depth), depth, strict=False):
        law = 350.0 * d
        contact = Contact(foot=(0.0, 0.0, 0.0), normal=UP, force=law, compression=d, indentation=0.0,
                          compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
        answer = node.step(contact, None, Pose(position=(0.0, 0.0, -d), velocity=(0.0, 0.0, 0.0), dt=1e-3), dt=1e-3)
        assert answer.force[2] == approx(law, abs=1e-12 if d >= before else 0.02)


def test_a_rigid_wall_is_rendered_with_the_stiffest_slope():
    for delay in (0, 2, 5):
        z, force, *_ = meet(1e9, delay, speed=0.0, push=0.5, seconds=12.0)
        assert -force[-1] / z[-1] == approx(stiffest(0.1, 0.2, 60e-6, (delay + 0.5) * 1e-3), rel=0.1)
