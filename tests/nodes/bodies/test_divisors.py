"""The contact between the steps of a body: with a divisor or a held message, the force is the same as with a body that
runs at every tick."""

import math
from functools import cache

import msgspec
import numpy as np
import pytest
from test_bodies import BODIES, UP, Loop

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Proximity
from palpate.nodes.base.contacts import press_body
from palpate.physics.contact.terminal import Terminal, law_at
from palpate.records.reader import Recording

MS = 1_000_000
TIME = np.arange(1, 501) * 1e-3
PATHS = {
    "press": np.interp(TIME, [0, 0.1, 0.3, 0.4], [0, 8e-3, 8e-3, 0]),
    "hold": np.interp(TIME, [0, 0.2, 0.4, 0.5], [0, 7e-3, 7e-3, 5e-3]),
    "tap": np.interp(TIME, [0.05, 0.08, 0.11], [0, 6e-3, 0]),
}


class Timed(Loop):
    """A touch with a divisor `every` of the body, whose message reaches the contact unless it is held."""

    def __init__(self, kind, every, held=()):
        super().__init__(kind)
        self.every, self.held, self.tick = every, set(held), 0
        self.sent = self.surface = msgspec.structs.replace(self.surface, tick=0, time=0)

    def press(self, approach, dt=1e-3):
        self.tick += 1
        if self.tick not in self.held:
            self.surface = self.sent
        contact = self.contact.step(
            Proximity(
                foot=(0, 0, 0), normal=UP, coordinates=(0, 0), element=0, gap=0, approach=approach, slip=(0, 0, 0),
                tick=self.tick, time=self.tick * MS,
            ),
            self.surface,
            dt=dt,
        )  # fmt: skip
        load = self.spread.step(contact, None)
        if self.tick % self.every == 0:
            answer = press_body(self.body, load, dt=self.every * dt)
            self.sent = msgspec.structs.replace(answer, tick=self.tick, time=self.tick * MS)
        return contact


def forces(kind, path, every=1, held=()):
    loop = Timed(kind, every, held)
    return np.array([loop.press(float(e)).force for e in path])


@cache
def fine_forces(name, path):
    return forces(named(name), PATHS[path])


def named(name):
    return next(kind for kind in BODIES if kind.__name__ == name)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("every", [2, 3, 10, 40])
@pytest.mark.parametrize("name", ["MassSpring", "Rigid"])
def test_a_law_that_does_not_change_gives_the_same_force_at_any_divisor(name, every, path):
    fine, coarse = fine_forces(name, path), forces(named(name), PATHS[path], every)
    assert coarse == pytest.approx(fine, rel=1e-7, abs=1e-9 * fine.max())


@pytest.mark.parametrize(("path", "most"), [("press", 1.5e-3), ("hold", 1e-3), ("tap", 5e-3)])
def test_the_reduced_body_gives_the_fine_force_at_a_divisor(path, most):
    fine = fine_forces("ReducedFE", path)
    for every in (10, 5, 2):
        assert np.abs(forces(named("ReducedFE"), PATHS[path], every) - fine).max() < most * fine.max()


@pytest.mark.parametrize(("path", "most"), [("press", 0.12), ("hold", 0.05)])
def test_beams_converge_to_the_fine_force_with_the_divisor(path, most):
    fine = fine_forces("BeamBundle", path)
    errors = [np.abs(forces(named("BeamBundle"), PATHS[path], every) - fine).max() / fine.max() for every in (10, 2)]
    assert errors[0] < most and errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("kind", BODIES, ids=lambda kind: kind.__name__)
def test_messages_held_at_some_ticks_hardly_change_the_force(kind):
    """Below the strain limit of the beams, which a held law cannot predict."""
    rng = np.random.default_rng(5)
    held = {int(start + k) for start in rng.integers(5, 480, 40) for k in range(rng.integers(1, 9))}
    path = np.interp(TIME, [0, 0.2, 0.4, 0.5], [0, 4e-3, 4e-3, 3e-3])
    fine, late = forces(kind, path), forces(kind, path, 1, held)
    assert np.abs(late - fine).max() < 0.02 * fine.max()


@pytest.mark.parametrize("kind", BODIES, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("every", [3, 10])
def test_a_closed_touch_dissipates_work_with_a_divisor(kind, every):
    for path in PATHS.values():
        force = forces(kind, path, every)
        assert np.isfinite(force).all() and (force >= 0).all()
        assert force @ np.diff(path, prepend=0.0) > 0


@pytest.mark.parametrize("tau", [1e-3, 0.02, 1.4])
@pytest.mark.parametrize("step", [1e-3, 10e-3])
@pytest.mark.parametrize("age", [0.5e-3, 1e-3, 4e-3, 10e-3, 30e-3])
def test_the_law_of_a_kelvin_voigt_body_at_an_age_equals_a_step_of_that_length(tau, step, age):
    """f = k s + k tau s', by implicit Euler: s = (s_prev tau + f/k a)/(a + tau)."""
    k, before, force = 300.0, 2e-3, 0.7

    def after(length, f, start):
        return (start * tau + f / k * length) / (length + tau)

    law = Terminal(k * (step + tau) / step, 1.0, 0.0, after(step, 0.0, before), before)
    for start in (before, 0.5e-3):
        stiffness, free = law_at(age, start, law, step, tau)
        assert free == pytest.approx(after(age, 0.0, start))
        assert free + force / stiffness == pytest.approx(after(age, force, start))


def test_a_law_without_times_is_used_unchanged():
    law = Terminal(3e3, 1.5, 0.0, 1e-3, 2e-3)
    assert law_at(5e-3, 2e-3, law, 0.0, 0.02) == (3e3, 1e-3)
    assert law_at(5e-3, 2e-3, law, 1e-3, 0.0) == (3e3, 1e-3)
    assert law_at(1e-3, 2e-3, law, 1e-3, 0.02) == pytest.approx((3e3, 1e-3), rel=1e-12)


STROKE = (
    "scene.hand.path=[{to: [0, 0, 0.0935], time: 0.3}, {to: [0.01, 0, 0.0935], time: 0.2, shape: linear}, "
    "{to: [0.01, 0, 0.115], time: 0.3}]"
)


def test_a_whole_run_has_the_same_forces_with_a_divisor_of_the_body(tmp_path):
    """A compliant hand presses, strokes and leaves the kidney, with friction."""
    runs = []
    for every in (1, 10):
        file = tmp_path / f"{every}.mcap"
        sets = (f"tissue.every={every}", "scene.surface.vertices=800", "scene.hand.begin=[0, 0, 0.111]", STROKE)
        launch = find("kidney").but(record=file, place="fused", duration=0.9, overrides=sets)
        assert execute(launch).result.ok
        runs.append(Recording(file).columns("contact")["force"])
    assert runs[0].max() > 2.0
    assert np.abs(runs[1] - runs[0]).max() < 1e-6
    assert math.isfinite(runs[1].sum())
