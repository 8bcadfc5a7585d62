"""One contract for every deformable body: each can replace any other in a graph.

Every class of `palpate.nodes.deformation` is found and tried with its default settings on a small plane.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx

from palpate.launch.load.classes import classes
from palpate.launch.testing import FakeBus
from palpate.messages import Load, Proximity, Surface
from palpate.nodes import deformation
from palpate.nodes.base import inputs, outputs
from palpate.nodes.base import settings as settings_of
from palpate.nodes.base.contacts import press_body
from palpate.nodes.base.surface import complete
from palpate.nodes.contact import Series
from palpate.nodes.spread import Kernel

BODIES = list(classes(deformation))
PLANE = {"surface": "plane", "vertices": 900, "position": (0.0, 0.0, 0.0)}
UP = (0.0, 0.0, 1.0)
every_body = pytest.mark.parametrize("kind", BODIES, ids=lambda k: k.__name__)


def make(kind):
    return kind(**{k: v for k, v in PLANE.items() if k in settings_of(kind)})


class Loop:
    """Contact, spreading and one body, step by step; the contact uses the body's message of the previous step."""

    def __init__(self, kind):
        self.contact, self.spread, self.body = Series(), Kernel(**PLANE), make(kind)
        for node in (self.contact, self.spread, self.body):
            node.start()
        self.surface = press_body(self.body, nothing(), dt=1e-3)

    def press(self, approach, dt=1e-3):
        contact = self.contact.step(touching(approach), self.surface, dt=dt)
        self.surface = press_body(self.body, self.spread.step(contact, None), dt=dt)
        return contact


def touching(approach):
    return Proximity(foot=(0, 0, 0), normal=UP, coordinates=(0, 0), element=0, gap=0, approach=approach, slip=(0, 0, 0))


def nothing():
    return Load(nodes=[], forces=np.zeros((0, 3)), foot=(0, 0, 0), normal=UP)


def test_a_finger_that_lifts_off_a_nodule_keeps_its_last_law():
    body = deformation.MassSpring(**PLANE, nodule_radius=4e-3)
    body.start()
    middle = int(np.argmin((body.mesh().vertices ** 2).sum(axis=1)))
    load = Load(nodes=[middle], forces=np.array([[0.0, 0.0, -1.0]]), foot=(0, 0, 0), normal=UP)
    hard = body.step([load], dt=1e-3).stiffness
    assert hard > 1.1 * body.stiffness
    assert [body.step([nothing()], dt=1e-3).stiffness for _ in range(3)] == [hard] * 3


def check_law(surface):
    numbers = (
        surface.stiffness,
        surface.exponent,
        surface.damping,
        surface.rest_indentation,
        surface.previous_indentation,
    )
    assert all(map(math.isfinite, numbers))
    assert surface.stiffness > 0 and 1 <= surface.exponent <= 3 and surface.damping >= 0
    assert np.isfinite(surface.displacement).all()
    assert (surface.nodes >= 0).all()


@every_body
def test_a_body_receives_a_load_and_sends_a_surface(kind):
    assert inputs(kind)[0].type is Load and outputs(kind) == (Surface,)
    (surface,) = FakeBus(make(kind)).publish(nothing())
    check_law(surface)


@every_body
def test_without_load_nothing_moves(kind):
    for surface in FakeBus(make(kind)).publish(*[nothing()] * 5):
        assert np.abs(surface.displacement).max(initial=0.0) == 0.0
        assert surface.rest_indentation == approx(0.0, abs=1e-12) and surface.previous_indentation == approx(
            0.0, abs=1e-12
        )


@every_body
def test_pressing_holding_and_releasing_stays_finite_and_dissipates(kind):
    loop = Loop(kind)
    t = np.arange(1, 501) * 1e-3
    path = np.interp(t, [0, 0.1, 0.3, 0.4], [0, 6e-3, 6e-3, 0])
    forces = []
    for e in path:
        answer = loop.press(float(e))
        forces.append(answer.force)
        assert math.isfinite(answer.force) and answer.force >= 0
        assert answer.compression >= 0
        check_law(loop.surface)
    forces = np.array(forces)
    assert forces.max() > 0.1 and (forces[400:] == 0).all()
    assert forces @ np.diff(path, prepend=0.0) > 0
    assert forces[299] <= forces[99] * (1 + 1e-9)


@every_body
def test_the_surface_indents_under_the_finger_and_recovers(kind):
    loop = Loop(kind)
    for _ in range(200):
        loop.press(6e-3)
    pressed = loop.surface
    if pressed.nodes.size:
        assert pressed.displacement[:, 2].min() < -1e-4
    for _ in range(400):
        loop.press(0.0, dt=0.05)
    assert np.abs(loop.surface.displacement).max(initial=0.0) < 1e-4
    assert abs(loop.surface.rest_indentation) < 1e-4


@every_body
@settings(max_examples=10, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 10e-3), st.floats(-6, -1)), min_size=1, max_size=15))
def test_random_jumps_and_steps_stay_finite(kind, path):
    loop = Loop(kind)
    for e, exponent in path:
        answer = loop.press(e, dt=10.0**exponent)
        assert math.isfinite(answer.force) and answer.force >= 0
        check_law(loop.surface)


@every_body
@pytest.mark.parametrize("dt", [1e-6, 1e-4, 1e-3, 1e-2, 0.1])
def test_a_closed_cycle_never_generates_energy_with_any_step(kind, dt):
    loop = Loop(kind)
    path = np.concatenate([np.linspace(0, 5e-3, 20)[1:], np.linspace(5e-3, 0, 20)[1:], np.zeros(3)])
    forces = np.array([loop.press(float(e), dt).force for e in path])
    assert forces @ np.diff(path, prepend=0.0) >= -1e-12
    assert (forces[-3:] == 0).all()


@every_body
def test_a_duplicate_message_changes_nothing(kind):
    bus = FakeBus(make(kind))
    on = Load(nodes=[3, 4], forces=[[0, 0, -0.5], [0, 0, -0.5]], foot=(0, 0, 0), normal=UP)
    bus.twice()
    first, second = bus.publish(on)
    assert (
        first.previous_indentation == second.previous_indentation and (first.displacement == second.displacement).all()
    )


@every_body
def test_a_restart_is_a_reset(kind):
    node = make(kind)
    on = Load(nodes=[3, 4], forces=[[0, 0, -0.5], [0, 0, -0.5]], foot=(0, 0, 0), normal=UP)
    (first,) = FakeBus(node).publish(on)
    (again,) = FakeBus(node).publish(on)
    assert first.previous_indentation == again.previous_indentation and (first.displacement == again.displacement).all()


@every_body
def test_the_surface_is_continuous_at_the_rim_of_the_sent_vertices(kind):
    """A body with independent vertices lists all that move; a body that moves as a whole omits vertices only between
    listed ones."""
    loop = Loop(kind)
    for _ in range(100):
        loop.press(6e-3)
    surface = loop.surface
    if not len(surface.nodes):
        return
    mesh = loop.body.mesh()
    shown = complete(surface, mesh.vertices)
    if shown is surface:
        loaded = loop.spread.step(loop.contact.step(touching(6e-3), surface, dt=1e-3), None).nodes
        assert set(loaded.tolist()) <= set(surface.nodes.tolist())
        return
    assert len(shown.nodes) == len(mesh.vertices) > 2 * len(surface.nodes)
    everything = kind(**PLANE, reach=1.0)
    everything.start()
    law = loop.surface
    whole = Loop(kind)
    whole.body, whole.surface = everything, press_body(everything, nothing(), dt=1e-3)
    for _ in range(100):
        whole.press(6e-3)
    assert whole.surface.rest_indentation == law.rest_indentation and len(whole.surface.nodes) == len(mesh.vertices)
    greatest = np.linalg.norm(whole.surface.displacement, axis=1).max()
    assert np.linalg.norm(shown.displacement - whole.surface.displacement, axis=1).max() < 0.02 * greatest


def test_the_pressure_of_reduced_fe_is_that_of_the_load_and_sums_to_its_force():
    loop = Loop(deformation.ReducedFE)
    for _ in range(60):
        contact = loop.press(5e-3)
    surface, areas = loop.surface, loop.body.mesh().areas
    assert len(surface.pressure) == len(surface.nodes)
    assert surface.pressure @ areas[surface.nodes] == approx(contact.force, rel=1e-9)
    assert surface.pressure.max() == approx(
        3 * contact.force / (np.pi * 8e-3**2), rel=0.25
    )  # at a vertex off the middle
    shown = complete(surface, loop.body.mesh().vertices)
    assert shown.pressure @ areas == approx(contact.force, rel=1e-9)
