"""The mass-spring body."""

import math

import numpy as np
import pytest
from formulas import series_path
from hypothesis import given, settings
from hypothesis import strategies as st
from pressing import NodalBody, Spreader
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Load, Proximity
from palpate.nodes.contact import Series
from palpate.nodes.deformation import MassSpring
from palpate.nodes.spread import Kernel
from palpate.physics.bodies.mass_spring import MOST_STRAIN
from palpate.physics.contact.series import exponential
from palpate.physics.contact.spread import kernel_values
from palpate.physics.contact.terminal import indentation, law_at, terminal_force
from palpate.physics.geometry.mesh import plane

K, N, C = 3.0e3, 1.5, 5.0
UP = (0.0, 0.0, 1.0)
NOTHING = (np.zeros(0, np.int32), np.zeros((0, 3)))
MESH = plane(0.06, 61**2)
steps = pytest.mark.parametrize("dt", [1e-6, 1e-4, 1e-3, 0.1])


def load(force, foot=(0.0, 0.0, 0.0), radius=8e-3, mesh=MESH):
    spreader = Spreader(mesh, radius)
    count = spreader.spread(foot, UP, force)
    return spreader.nodes[:count].copy(), spreader.forces[:count].copy()


def nodal(damping=C, mesh=MESH, k_t=300.0, d_t=3.0):
    return NodalBody(mesh, K, N, damping, k_t, d_t)


def dense(displaced, mesh=MESH):
    out = np.zeros((len(mesh.vertices), 3))
    out[displaced[0]] = displaced[1]
    return out


def test_at_rest_the_surface_has_the_indentation_and_the_shape_of_the_kernel():
    s = (2.0 / K) ** (1 / N)
    displacement = dense(nodal().step(*load((0.0, 0.0, -2.0)), UP, math.inf))
    d = np.linalg.norm(MESH.vertices, axis=1)
    assert -displacement[:, 2] == approx(s * kernel_values("biweight", d / 8e-3) ** (1 / N), abs=1e-12)


@steps
def test_each_node_satisfies_its_implicit_step(dt):
    body = nodal()
    nodes, forces = load((0.0, 0.0, -1.5))
    before = np.zeros(len(MESH.vertices))
    rng = np.random.default_rng(0)
    for _ in range(4):
        scale = rng.uniform(0.1, 3)
        depth = -dense(body.step(nodes, forces * scale, UP, dt))[:, 2]
        p = -forces[:, 2] * scale / MESH.areas[nodes]
        total = 1.5 * scale
        for j in range(0, len(nodes), 17):
            node = nodes[j]
            goal = total * p[j] / p.max()
            value = terminal_force(depth[node], dt, K, N, C, 0.0, before[node])[0]
            assert value == approx(goal, rel=1e-7)
        before = depth


def test_a_symmetric_load_gives_a_symmetric_surface():
    depth = dense(nodal().step(*load((0.0, 0.0, -2.0)), UP, 1e-3))[:, 2].reshape(61, 61)
    assert depth == approx(depth[::-1], abs=1e-15)
    assert depth == approx(depth[:, ::-1], abs=1e-15)
    assert depth == approx(depth.T, abs=1e-15)


def test_the_surface_moves_continuously_with_the_foot():
    before = None
    spreader, body = Spreader(MESH, 8e-3), nodal(mesh=MESH)
    for x in np.linspace(0, 2e-3, 401):
        count = spreader.spread((x, 0.3e-3, 0.0), UP, (0.0, 0.0, -2.0))
        displacement = dense(body.step(spreader.nodes[:count], spreader.forces[:count], UP, math.inf))
        assert before is None or np.abs(displacement - before).max() < 30e-6
        before = displacement


@steps
def test_after_release_the_surface_returns_without_overshoot(dt):
    body = nodal()
    on = load((0.5, 0.0, -2.0))
    for _ in range(20):
        body.step(*on, UP, max(dt, 1e-3))
    size = np.linalg.norm(dense(body.step(*NOTHING, UP, dt)), axis=1).max()
    for _ in range(60):
        displacement = dense(body.step(*NOTHING, UP, dt))
        now = np.linalg.norm(displacement, axis=1).max()
        assert now <= size * (1 + 1e-9) + 1e-12
        assert displacement[:, 2].max() < 1e-9
        size = now
    for _ in range(300):
        displacement = dense(body.step(*NOTHING, UP, 0.05))
    assert (displacement == 0).all()


def test_released_nodes_recover_at_the_rate_of_their_damping():
    body = nodal()
    body.step(*load((0.0, 0.0, -2.0)), UP, math.inf)
    one = -dense(body.step(*NOTHING, UP, 1e-3))[:, 2].min()
    two = -dense(body.step(*NOTHING, UP, 1e-3))[:, 2].min()
    assert one - two == approx(1e-3 / C, rel=1e-9)


def test_the_tangential_spring_is_backward_euler():
    body, at, dt = nodal(), load((0.3, 0.0, -2.0)), 1e-3
    expected = 0.0
    for _ in range(5):
        stretch = dense(body.step(*at, UP, dt))[:, 0].max()
        expected = (0.3 * dt + 3.0 * expected) / (300.0 * dt + 3.0)
        assert stretch == approx(expected, rel=1e-9)
    for _ in range(300):
        stretch = dense(body.step(*at, UP, dt))[:, 0].max()
    assert stretch == approx(0.3 / 300.0, rel=1e-6)


def test_neighbours_never_separate_beyond_the_limit():
    body = nodal(k_t=20.0)
    edges = np.concatenate([MESH.triangles[:, [0, 1]], MESH.triangles[:, [1, 2]], MESH.triangles[:, [2, 0]]])
    lengths = np.linalg.norm(MESH.vertices[edges[:, 0]] - MESH.vertices[edges[:, 1]], axis=1)
    for force in ((3.0, 0.0, -4.0), (-3.0, 2.0, -4.0), (0.0, 0.0, -9.0)):
        at = load(force, foot=(0.3e-3, 0.1e-3, 0.0))
        for _ in range(6):
            displacement = dense(body.step(*at, UP, 0.05))
            parted = np.linalg.norm(displacement[edges[:, 0], :2] - displacement[edges[:, 1], :2], axis=1)
            assert (parted <= MOST_STRAIN * lengths * (1 + 1e-9)).all()


def test_a_tangential_load_never_inverts_a_triangle():
    body = nodal(k_t=20.0)
    displacement = dense(body.step(*load((5.0, 1.0, -5.0)), UP, 1.0))
    corner = (MESH.vertices + displacement)[MESH.triangles][:, :, :2]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all()


def test_only_displaced_nodes_are_listed():
    body = nodal()
    spreader = Spreader(MESH, 4e-3)
    for i in range(300):
        count = spreader.spread((-0.02 + 1e-4 * i, 0.0, 0.0), UP, (0.0, 0.0, -0.5))
        nodes, _ = body.step(spreader.nodes[:count], spreader.forces[:count], UP, 1e-2)
        assert len(nodes) < 3 * count and len(set(nodes.tolist())) == len(nodes)
    outside = np.setdiff1d(np.arange(len(MESH.vertices)), nodes)
    assert (body.own.where[0, outside] == -1).all()


def test_the_displacement_does_not_depend_on_the_size_of_the_mesh():
    large = plane(0.18, 181**2)
    small = dense(nodal().step(*load((0.1, 0.0, -2.0)), UP, 1e-3))
    wide = dense(nodal(mesh=large).step(*load((0.1, 0.0, -2.0), mesh=large), UP, 1e-3), large)
    assert wide.reshape(181, 181, 3)[60:121, 60:121] == approx(small.reshape(61, 61, 3), abs=1e-12)


def test_forces_on_unknown_nodes_are_ignored():
    nodes, displacement = nodal().step(np.array([-3, 10**6], np.int32), np.full((2, 3), -1.0), UP, 1e-3)
    assert len(nodes) == 0 and displacement.shape == (0, 3)


@settings(max_examples=20, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0, 9), st.floats(-5, 5), st.floats(-0.02, 0.02), st.floats(-6, -1)), min_size=1, max_size=6
    ),
)
def test_any_load_and_step_stays_finite_and_bounded(path):
    body = nodal(mesh=SMALL)
    for normal, tangential, x, exponent in path:
        at = load((tangential, 0.0, -normal), foot=(x, 0.0, 0.0), radius=5e-3, mesh=SMALL)
        displacement = dense(body.step(*at, UP, 10.0**exponent), SMALL)
        assert np.isfinite(displacement).all() and np.abs(displacement).max() < 0.1


SMALL = plane(0.05, 26**2)


def proximity(e):
    return Proximity(foot=(0, 0, 0), normal=UP, coordinates=(0, 0), element=0, gap=4e-3 - e, approach=e, slip=(0, 0, 0))


def test_contact_with_the_node_equals_the_monolithic_series_solution():
    at_rest, tissue = (FakeBus(MassSpring(surface="plane", vertices=2500, position=(0, 0, 0))) for _ in range(2))
    contact = FakeBus(Series())
    spread = FakeBus(Kernel(surface="plane", vertices=2500, position=(0, 0, 0)))
    t = np.arange(1, 401) * 1e-3
    e = np.interp(t, [0, 0.1, 0.3, 0.4], [0, 8e-3, 8e-3, 0]) * (1 + 0.1 * np.sin(300 * t))
    forces, s2 = [], []
    (surface,) = at_rest.publish(Load(nodes=[], forces=np.zeros((0, 3)), foot=(0, 0, 0), normal=UP))
    for x in e:
        contact.hold("body", surface)
        (pressed,) = contact.publish(proximity(x))
        (surface,) = tissue.publish(*spread.publish(pressed))
        forces.append(pressed.force)
        s2.append((pressed.indentation, surface.previous_indentation))
    whole, _, _ = series_path(e, 1e-3, exponential(26.2641, 1681.06), 8.0, K, N, C)
    assert forces == approx(whole, rel=1e-9, abs=1e-12)
    assert [a for a, _ in s2] == approx([b for _, b in s2], rel=1e-9, abs=1e-14)


def test_the_field_is_omitted_if_it_is_not_wanted():
    on = Load(nodes=[5, 6], forces=[[0, 0, -1.0], [0, 0, -1.0]], foot=(0, 0, 0), normal=UP)
    (full,) = FakeBus(MassSpring(surface="plane", vertices=400)).publish(on)
    node = MassSpring(surface="plane", vertices=400)
    node.wanted = frozenset({"stiffness", "previous_indentation"})
    (lean,) = FakeBus(node).publish(on)
    assert full.nodes.size == 2 and lean.nodes.size == 0
    assert lean.previous_indentation == full.previous_indentation > 0


def retarded_path(dt, forces, **law):
    """Indentations [m] of the node under these normal forces [N], one per step of dt [s]."""
    node = MassSpring(surface="plane", vertices=400, position=(0, 0, 0), **law)
    bus, depths = FakeBus(node, rate=1.0 / dt), []
    for f in forces:
        (sent,) = bus.publish(Load(nodes=[0], forces=[(0.0, 0.0, -f)], foot=(0, 0, 0), normal=UP))
        depths.append(sent.previous_indentation)
    return np.array(depths)


def test_a_retarded_spring_converges_to_the_kelvin_voigt_solid_with_order_1():
    """Under f = F sin(wt) from rest, K (s + tau s') = f has s = F/K (sin wt - wq cos wt + wq e^(-t/q))/(1 + (wq)^2)."""
    tau, w, force = 0.02, 2.0 * math.pi * 5.0, 2.0
    errors = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        t = dt * np.arange(1, round(0.09 / dt) + 1)
        found = retarded_path(dt, force * np.sin(w * t), stiffness=250.0, exponent=1.0, damping=0.0, retardation=tau)
        q = w * tau
        exact = force / 250.0 * (np.sin(w * t) - q * np.cos(w * t) + q * np.exp(-t / tau)) / (1.0 + q * q)
        errors.append(np.abs(found - exact).max() / exact.max())
    assert errors[0] < 0.02
    assert math.log2(errors[0] / errors[1]) == approx(1.0, abs=0.1) == math.log2(errors[1] / errors[2])


@given(st.floats(1.0, 3.0), st.floats(0.0, 10.0), st.floats(0.0, 0.2), st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_a_retarded_spring_never_returns_more_work_than_it_received(n, c, tau, seed):
    rng = np.random.default_rng(seed)
    forces = np.repeat(rng.uniform(0.0, 4.0, 40) * rng.integers(0, 2, 40), rng.integers(1, 30, 40))
    law = {"stiffness": 250.0 * 8e-3 ** (1.0 - n), "exponent": n, "damping": c, "retardation": tau}
    depths = retarded_path(1e-3, forces, **law)
    work = np.cumsum(forces * np.diff(depths, prepend=0.0))
    stored = law["stiffness"] * depths ** (n + 1.0) / (n + 1.0)
    assert (work >= stored - 1e-9).all() and (depths >= 0.0).all()


def test_without_load_a_retarded_spring_recovers_exponentially_and_then_sleeps():
    law = {"stiffness": 250.0, "exponent": 1.0, "damping": 0.0, "retardation": 0.01}
    depths = retarded_path(1e-3, [2.0] * 200 + [0.0] * 400, **law)
    assert depths[199] == approx(2.0 / 250.0, rel=1e-6)
    assert depths[200:260] == approx(depths[199] * (10.0 / 11.0) ** np.arange(1, 61), rel=1e-9)
    assert depths[-1] == 0.0


def test_the_law_of_a_retarded_spring_is_valid_for_any_step_length():
    """A contact at another rate converts the law; for this body the conversion is exact, for every exponent."""
    node = MassSpring(surface="plane", vertices=400, exponent=1.4, damping=0.0, retardation=0.01)
    bus = FakeBus(node)
    (sent,) = bus.publish(Load(nodes=[0], forces=[(0.0, 0.0, -1.0)], foot=(0, 0, 0), normal=UP))
    before, force, length = sent.previous_indentation, 1.7, 3e-3
    law = sent.stiffness, sent.exponent, 0.0, sent.rest_indentation, before
    stiffness, free = law_at(length, before, law, sent.step, sent.relaxation)
    share = length / (length + 0.01)
    expected = (1.0 - share) * before + share * (force / node.stiffness) ** (1.0 / 1.4)
    assert indentation(force, length, stiffness, 1.4, 0.0, free, before) == approx(expected, rel=1e-9)
