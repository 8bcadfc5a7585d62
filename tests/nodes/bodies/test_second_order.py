"""Steps of second order: fast taps, corners, energy, and where the steps remain implicit Euler."""

from functools import cache

import msgspec
import numpy as np
import pytest
from pytest import approx
from test_bodies import PLANE, Loop, nothing, touching

from palpate.compiler.fields import blank_record
from palpate.nodes.base.contacts import press_body
from palpate.nodes.contact import Joint, Series
from palpate.nodes.deformation import MassSpring, ReducedFE
from palpate.physics.contact.end_rate import COURSE, STEPS, advance, arrive, expected_change

SPRING = {"stiffness": 270.0, "exponent": 1.0, "damping": 0.0, "retardation": 0.02}
BODIES = {"MassSpring": (MassSpring, SPRING), "ReducedFE": (ReducedFE, {})}
every_body = pytest.mark.parametrize("body", BODIES)


class Tapped(Loop):
    """Messages of successive ticks, unless a tick is lost."""

    def __init__(self, body, second_order, joint=False):
        kind, settings = BODIES[body]
        super().__init__(kind)
        self.contact = (Joint if joint else Series)(second_order=second_order)
        self.body = kind(**PLANE, **settings, second_order=second_order)
        for node in (self.contact, self.body):
            node.start()
        self.surface, self.tick, self.joint = press_body(self.body, nothing(), dt=1e-3), 0, joint

    def press(self, approach, dt=1e-3, lost=False):
        self.tick += 2 if lost else 1
        near = msgspec.structs.replace(touching(float(approach)), tick=self.tick)
        contact = self.contact.step([near] if self.joint else near, self.surface, dt=dt)
        if not self.joint:
            load = msgspec.structs.replace(self.spread.step(contact, None), tick=self.tick)
            self.surface = press_body(self.body, load, dt=dt)
        return contact


def tap(rate, seconds=0.03, depth=4e-3):
    time = np.arange(round(1.5 * seconds * rate) + 1) / rate
    return np.where(time < seconds, depth * (0.5 - 0.5 * np.cos(2 * np.pi * time / seconds)), 0.0) - 1e-4


@cache
def forces(body, rate, second_order=True):
    loop = Tapped(body, second_order)
    return np.array([loop.press(e, 1.0 / rate).force for e in tap(rate)])


def errors(body, second_order):
    """RMS and largest error over the peak at 1, 2, 4 kHz; the reference is implicit Euler, extrapolated."""
    fine = 2.0 * forces(body, 64000, False)[::16] - forces(body, 32000, False)[::8]
    found = [(forces(body, rate, second_order) - fine[:: 4000 // rate]) / fine.max() for rate in (1000, 2000, 4000)]
    return np.array([(np.sqrt(np.mean(e**2)), np.abs(e).max()) for e in found])


@pytest.mark.parametrize(("second_order", "order"), [(False, 1.0), (True, 2.0)])
def test_the_error_of_a_tap_falls_with_the_order_of_the_step(second_order, order):
    rms = errors("MassSpring", second_order)[:, 0]
    assert np.log2(rms[0] / rms[2]) / 2 == approx(order, abs=0.2)


@pytest.mark.parametrize("body", ["MassSpring", pytest.param("ReducedFE", marks=pytest.mark.long)])
def test_a_tap_of_30_ms_at_1_khz_is_within_3_percent(body):
    assert errors(body, True)[0, 1] < 0.03 < 0.07 < errors(body, False)[0, 1]


@every_body
@pytest.mark.parametrize("ticks", [5, 20, 60])
def test_a_press_that_stops_within_a_step_has_no_larger_error_than_with_implicit_euler(body, ticks):
    def pressed(second_order, finer=1):
        loop, steps = Tapped(body, second_order), np.arange(1, finer * (ticks + 20) + 1) / finer
        return np.array([loop.press(5e-3 * min(t / ticks, 1.0), 1e-3 / finer).force for t in steps])[finer - 1 :: finer]

    fine = 2.0 * pressed(False, 32) - pressed(False, 16)
    first, second = (np.abs(pressed(order) - fine) / fine.max() for order in (False, True))
    assert second.max() <= first.max() + 1e-3
    assert ticks < 20 or second[ticks + 1 :].max() < 5e-3


@every_body
@pytest.mark.parametrize("seed", range(3))
def test_any_closed_motion_takes_work_and_the_force_never_pulls(body, seed):
    random = np.random.default_rng(seed)
    tick = np.arange(300)
    waves = np.sin(2 * np.pi * random.uniform(5, 400) * tick / 1000 + random.uniform(0, 6))
    for shape in (0.06 * np.cumsum(random.standard_normal(300)), waves, np.sign(waves), random.uniform(-1, 1, 300)):
        path = np.concatenate([[-1e-4], 2e-3 * (1.0 + shape), np.full(100, -1e-4)])
        loop = Tapped(body, True)
        force = np.array([loop.press(e).force for e in path])
        assert force.min() >= 0.0 and np.isfinite(force).all()
        work = force[1:] * np.diff(path)
        assert work.sum() >= 0.3 * np.maximum(work, 0.0).sum()


@every_body
def test_law_and_compression_still_give_the_contact_force(body):
    loop = Tapped(body, True)
    for e in tap(1000):
        law = loop.surface
        contact = loop.press(e)
        if contact.force > 0.0:
            depth = contact.indentation - law.rest_indentation
            assert contact.force == approx(law.stiffness * depth**law.exponent, rel=1e-9)
            b, m, c = loop.contact.finger_stiffness, loop.contact.finger_hardening, loop.contact.finger_damping
            elastic = b / m * np.expm1(m * contact.compression)
            assert contact.force == approx(elastic * (1.0 + c * contact.compression_rate), rel=1e-9)


@every_body
def test_after_a_lost_tick_the_steps_are_implicit_euler_until_the_rates_are_known(body):
    path = tap(1000)[1:14]
    loop, euler = Tapped(body, True), Tapped(body, False)
    for e in path:
        loop.press(e, lost=True), euler.press(e, lost=True)
    assert loop.press(path[-1]).force == approx(euler.press(path[-1]).force, rel=1e-12)


def test_one_finger_has_the_same_force_with_and_without_a_joint():
    alone, joined = Tapped("MassSpring", True), Tapped("MassSpring", True, joint=True)
    for e in tap(1000):
        joined.surface = alone.surface
        contact, contacts = alone.press(e), joined.press(e)
        assert contacts.force[0] == approx(contact.force, rel=1e-12)


def test_the_expected_change_is_exact_for_rising_quadratic_rates_and_zero_for_a_single_change():
    t = -np.arange(1.0, STEPS + 1)  # of the last steps; the next one is at 0
    assert expected_change(2.0 + 3.0 * t) == approx(3.0)
    assert expected_change(2.0 + 3.0 * t - 0.25 * t**2) == approx(3.0 + 0.25)
    for k in range(STEPS):
        jump, pulse = np.where(np.arange(STEPS) <= k, 1.0, 0.0), np.eye(STEPS)[k]
        assert expected_change(jump) == expected_change(pulse) == 0.0


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_the_start_of_a_step_stays_between_zero_and_twice_the_value(scale):
    random, course = np.random.default_rng(5), blank_record(COURSE, ahead=1.0)
    for tick in range(200):
        arrive(course, tick)
        advance(course, scale * max(float(random.standard_normal()), 0.0), 1e-3)
        assert 0.0 <= course.ahead <= 2.0
