"""Friction along and across the sliding direction, against closed forms of LuGre in a turn and on a circle."""

import math

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Proximity
from palpate.nodes.friction import Components, LuGre
from palpate.physics.friction.components import SLOW, split_rows

UP, HERE = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
LOAD, SPEED, DT = 1.5, 0.05, 1e-3
LAW = {"bristle_stiffness": 500.0, "bristle_damping": 1.0, "viscous": 0.4, "mu_slide": 0.5, "mu_static": 0.7,
       "stribeck": 0.02}  # fmt: skip
G = 0.5 + 0.2 * math.exp(-((SPEED / 0.02) ** 2))
ALPHA = 500.0 * SPEED / G  # [1/s] rate at which the bristles forget


def proximity(slip, normal=UP):
    return Proximity(foot=HERE, normal=normal, slip=slip, coordinates=(0.0, 0.0), element=0, gap=0.0, approach=2e-3)


def contact(load=LOAD, normal=UP):
    return Contact(
        foot=HERE, normal=normal, force=load, compression=1e-3, indentation=1e-3, compression_rate=0.0,
        indentation_rate=0.0,
    )  # fmt: skip


def slide(slips, law=None):
    """The friction forces (n,3) of LuGre for slip velocities (n,3)."""
    bus = FakeBus(law or LuGre(play=0.0, **LAW))
    forces = []
    for slip in slips.tolist():
        bus.hold("proximity", proximity(tuple(slip)))
        forces.append(bus.publish(contact())[0].force)
    return np.array(forces)


def parts(forces, slips, slow=SLOW):
    count = len(slips)
    return split_rows(forces, np.tile(UP, (count, 1)), slips, np.full(count, LOAD), slow)


def test_a_straight_slide_has_no_force_across():
    slips = np.tile((0.6 * SPEED, 0.8 * SPEED, 0.0), (900, 1))
    along, across = parts(slide(slips), slips)
    assert abs(across).max() < 1e-12 and along[-1] == approx(LOAD * (G + 0.4 * SPEED), rel=1e-9)


def test_after_a_turn_the_force_across_decays_with_the_bristles():
    """z across v obeys dz/dt = -a z, so f_b = f_n (s0 z + s1 dz/dt), to the left or right of the new direction."""
    for turn in (1.0, -1.0):
        slips = np.array([(SPEED, 0.0, 0.0)] * 900 + [(0.0, turn * SPEED, 0.0)] * 60)
        _, across = parts(slide(slips), slips)
        before = G / 500.0 * np.exp(-ALPHA * DT * np.arange(60))
        after = before * math.exp(-ALPHA * DT)
        expected = LOAD * (500.0 * after + 1.0 * (after - before) / DT)
        # b = n × t: to the left of +y is -x, so the old force along +x is negative across
        assert across[900:] == approx(-turn * expected, rel=1e-9)
        assert abs(across[900]) > 0.3 and abs(across[-1]) < 0.06 * abs(across[900])  # e^{-3} later


def test_on_a_circle_the_force_lags_behind_the_direction():
    """v e^{iwt} gives z = v e^{iwt}/(a + iw): along and across are real and imaginary part of (s0 + iw s1) v/(a + iw)
    + s2 v; the steps are of first order."""
    w, errors = 2 * math.pi * 1.0, []
    exact = LOAD * ((500.0 + 1j * w) * SPEED / (ALPHA + 1j * w) + 0.4 * SPEED)
    for rate in (1000, 4000):
        time = np.arange(rate) / rate
        slips = np.stack([SPEED * np.cos(w * time), SPEED * np.sin(w * time), 0.0 * time], axis=1)
        bus = FakeBus(LuGre(play=0.0, **LAW), rate=rate)
        forces = []
        for slip in slips.tolist():
            bus.hold("proximity", proximity(tuple(slip)))
            forces.append(bus.publish(contact())[0].force)
        along, across = parts(np.array(forces), slips)
        errors.append(abs(along[-1] + 1j * across[-1] - exact))
    assert exact.imag < -0.05 and errors[0] < 0.01 and errors[1] < 0.3 * errors[0]


def test_the_parts_are_a_rotation_of_the_force(count=1000):
    """Any normal, direction and force: |f|² = f_f² + f_b², and the parts do not depend on the frame."""
    rng = np.random.default_rng(8)
    turns = Rotation.random(count, rng)
    normal = turns.apply(UP)
    force = turns.apply(np.column_stack([rng.normal(size=(count, 2)), np.zeros(count)]))
    angle = rng.uniform(-math.pi, math.pi, count)
    slip = turns.apply(SPEED * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)]))
    along, across = split_rows(force, normal, slip, np.ones(count))
    assert along**2 + across**2 == approx((force**2).sum(axis=1), rel=1e-9)
    flat = turns.inv().apply(force)
    way = np.exp(-1j * angle) * (flat[:, 0] + 1j * flat[:, 1])
    assert along + 1j * across == approx(way, abs=1e-9)


def test_a_slow_finger_keeps_its_direction_and_a_new_contact_has_none():
    fast, slow = (SPEED, 0.0, 0.0), (0.0, 0.9 * SLOW, 0.0)
    force = np.tile((0.3, 0.4, 0.0), (5, 1))
    load = np.array([1.0, 1.0, 1.0, 0.0, 1.0])
    along, across = split_rows(force, np.tile(UP, (5, 1)), np.array([slow, fast, slow, slow, slow]), load)
    assert along == approx([0.5, 0.3, 0.3, 0.0, 0.5]) and across == approx([0.0, 0.4, 0.4, 0.0, 0.0])


@pytest.mark.parametrize("slow", [0.0, SLOW, 0.2])
def test_the_node_sends_what_the_formula_computes(slow):
    rng = np.random.default_rng(9)
    slips = np.cumsum(rng.normal(size=(200, 3)) * (2e-3, 2e-3, 0.0), axis=0)
    forces = rng.normal(size=(200, 3)) * (1.0, 1.0, 0.0)
    loads = np.where(rng.random(200) < 0.1, 0.0, rng.uniform(0.1, 2.0, 200))
    bus, sent = FakeBus(Components(slow=slow)), []
    for slip, force, load in zip(slips.tolist(), forces.tolist(), loads.tolist(), strict=True):
        bus.hold("contact", contact(load))
        bus.hold("proximity", proximity(tuple(slip)))
        sent += bus.publish(Friction(force=tuple(force), bristle=HERE, stick=False))
    along, across = split_rows(forces, np.tile(UP, (200, 1)), slips, loads, slow)
    assert [one.along for one in sent] == along.tolist() and [one.across for one in sent] == across.tolist()
    assert [one.normal for one in sent] == loads.tolist()
    for one in sent:
        assert math.hypot(*one.direction) == approx(1.0) or one.direction == HERE
