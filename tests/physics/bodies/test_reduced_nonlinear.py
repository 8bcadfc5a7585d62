"""Large displacement of the condensed organ: comparison with the full model, and passivity."""

from functools import lru_cache

import numpy as np
import pytest
from formulas import series
from pressing import CondensedBody
from pytest import approx
from scipy.optimize import brentq

from palpate.compiler.entry_point import NO_FLOATS
from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.reducible import of_organ
from palpate.models.fe.reduce.snapshots import patch
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.large_displacement import DEEPEST
from palpate.physics.contact.series import exponential
from palpate.physics.contact.terminal import Terminal

YOUNG = 2e4
RADIUS = 12e-3
RHO = np.array([-0.35, 0.1, 0.0])
"""Parameter of an organ that softens far more than any tissue."""
UP = (0.0, 0.0, 1.0)
SHAPE = ("plane", 80)


@lru_cache
def organ():
    return of_organ(Organ(surface_mesh(*SHAPE)))


@lru_cache
def basis():
    mesh = organ().surface
    return Basis(mesh.vertices, mesh.triangles, organ().compliance().astype(np.float32))


def body(retardation=0.0, rho=RHO, young=YOUNG):
    return CondensedBody(basis(), organ().surface, young, retardation, RADIUS, 1.0, rho=rho)


def unit(foot, normal, radius=RADIUS):
    """Nodes and forces of a unit load on the coarse surface."""
    share = patch(organ().surface, foot, normal, radius)
    nodes = np.flatnonzero(np.abs(share).max(axis=1) > 0).astype(np.int32)
    return nodes, np.ascontiguousarray(share[nodes])


def at_vertex(v, radius=RADIUS):
    mesh = organ().surface
    foot, n = mesh.vertices[v], mesh.normals[v] / np.linalg.norm(mesh.normals[v])
    return tuple(foot.tolist()), tuple(n.tolist()), *unit(foot, n, radius)


def settled(it, foot, n, nodes, push, force):
    """Static answer of the body to a force."""
    return it.step(nodes, force * push, foot, n, 1e3)


def test_a_light_touch_is_linear():
    foot, n, nodes, push = at_vertex(40)
    a, b = (settled(body(rho=rho), foot, n, nodes, push, 1e-3)[2] for rho in (RHO, NO_FLOATS))
    assert a == approx(b, rel=1e-3)


def test_half_the_modulus_with_half_the_force_gives_the_same_indentation():
    foot, n, nodes, push = at_vertex(40)
    one = settled(body(), foot, n, nodes, push, 1.5)[2]
    soft = body(young=YOUNG / 2)
    assert soft.step(nodes, 0.75 * push, foot, n, 1e3)[2] == approx(one, rel=1e-9)


def test_the_mean_displacement_of_the_patch_is_the_indentation():
    foot, n, nodes, push = at_vertex(49)
    it = body()
    s = settled(it, foot, n, nodes, push, 1.4)[2]
    vertices, moved = it.displaced(foot)
    u = np.zeros_like(organ().surface.vertices)
    u[vertices] = moved
    assert np.sum(push * u[nodes]) == approx(s, rel=1e-5)


def test_random_presses_at_a_point_never_gain_work():
    """The stored energy is the Legendre transform of V*, whose derivative is the indentation, so it is the integral of
    f ds at rest."""
    foot, n, nodes, push = at_vertex(49)
    it, rng = body(0.02), np.random.default_rng(4)
    work = before = 0.0
    for _ in range(300):
        force, dt = rng.random() * 1.8 * (rng.random() < 0.7) + 1e-9, 10.0 ** rng.uniform(-4, 0)
        s = it.step(nodes, force * push, foot, n, dt)[2]
        work += force * (s - before)
        before = s
        assert work >= -1e-12
    steps = np.linspace(0, float(np.sum(-it.held @ n)), 400)
    rest = body()
    depth = np.array([settled(rest, foot, n, nodes, push, max(f, 1e-9))[2] for f in steps])
    assert depth[-1] == approx(before, rel=1e-6)
    assert work >= np.sum(0.5 * (steps[1:] + steps[:-1]) * np.diff(depth)) * (1 - 1e-4)


@pytest.mark.parametrize("dt", [1e-5, 1e-3, 0.1, 100.0])
def test_a_closed_cycle_of_indentation_by_a_finger_dissipates_energy(dt):
    foot, n, nodes, push = at_vertex(49)
    finger, it = exponential(60.0, 900.0), body(0.02)
    law, s1, gained = it.step(nodes[:0], push[:0], foot, n, dt), 0.0, 0.0
    way = np.concatenate([np.linspace(0, 12e-3, 60), np.linspace(12e-3, 0, 60)])
    last = 0.0
    for e in way:
        f, s1, _ = series(float(e), dt, s1, finger, 0.0, Terminal(1 / law[0], 1.0, 0.0, law[1], law[2]))
        gained += f * (e - last)
        last = e
        law = it.step(nodes, f * push, foot, n, dt) if f > 0 else it.step(nodes[:0], push[:0], foot, n, dt)
        assert np.isfinite(law).all() and law[0] > 0
    assert f < 1e-6  # in a step of 100 s the law is a tangent, which begins a little above the surface
    assert gained >= -1e-9


def test_contact_in_series_settles_at_the_static_force():
    foot, n, nodes, push = at_vertex(49)
    finger, it = exponential(60.0, 900.0), body()
    law, s1 = it.step(nodes[:0], push[:0], foot, n, 1e3), 0.0
    for _ in range(60):
        f, s1, _ = series(6e-3, 1e3, s1, finger, 0.0, Terminal(1 / law[0], 1.0, 0.0, law[1], law[2]))
        law = it.step(nodes, f * push, foot, n, 1e3)

    def miss(force):
        own = np.log1p(force * 900.0 / 60.0) / 900.0
        return own + settled(body(), foot, n, nodes, push, force)[2] - 6e-3

    assert f == approx(brentq(miss, 1e-6, 3.0, xtol=1e-12), rel=1e-4)


def test_a_loaded_sliding_finger_feels_no_jump():
    mesh = surface_mesh("plane", 2500)
    it, laws = CondensedBody(basis(), mesh, YOUNG, 0.02, RADIUS, 1.0, rho=RHO), []
    for x in np.linspace(-0.02, 0.02, 801):
        foot = np.array([x, 0.3 * x, 0.0])
        q = np.linalg.norm(mesh.vertices - foot, axis=1) / RADIUS
        nodes = np.flatnonzero(q < 1).astype(np.int32)
        share = (1 - q[nodes] ** 2) ** 2
        laws.append(it.step(nodes, np.outer(share / share.sum(), (0, 0, -2.5)), tuple(foot), UP, 1e-3))
    later = np.array(laws[200:])
    assert (np.abs(np.diff(later, axis=0)).max(axis=0) < 0.01 * later.mean(axis=0)).all()


class Finger:
    """A fingertip on the body that follows foot points on a fine plane at given approaches."""

    def __init__(self, retardation=0.02):
        self.mesh = surface_mesh("plane", 2500)
        self.body = CondensedBody(basis(), self.mesh, YOUNG, retardation, RADIUS, 1.0, rho=RHO)
        self.law, self.compression = self.body.step(np.zeros(0, np.int32), np.zeros((0, 3)), (0, 0, 0), UP, 1e-3), 0.0

    def to(self, foot, approach, dt=1e-3):
        """Force of the next step."""
        law = Terminal(1 / self.law[0], 1.0, 0.0, self.law[1], self.law[2])
        force, self.compression, _ = series(approach, dt, self.compression, exponential(60.0, 900.0), 0.0, law)
        q = np.linalg.norm(self.mesh.vertices - foot, axis=1) / RADIUS
        nodes = np.flatnonzero(q < 1).astype(np.int32)
        share = (1 - q[nodes] ** 2) ** 2
        self.law = self.body.step(nodes, np.outer(share / share.sum(), (0, 0, -max(force, 1e-9))), tuple(foot), UP, dt)
        return force


def test_at_constant_approach_half_the_step_changes_the_force_by_half():
    """Therefore there is no jump, also at edges of triangles."""
    biggest = []
    for steps in (500, 1000):
        finger = Finger()
        for _ in range(400):
            finger.to(np.array([-0.02, -0.006, 0.0]), 8e-3)
        slide = [finger.to(np.array([x, 0.3 * x, 0.0]), 8e-3) for x in np.linspace(-0.02, 0.02, steps)]
        biggest.append(np.abs(np.diff(slide)).max())
    assert biggest[1] < 0.6 * biggest[0]
    assert biggest[1] < 2e-3 * slide[-1]


def test_the_energy_gain_of_a_slide_is_at_most_the_difference_of_stored_energies():
    """With a normal force alone a slide can generate energy, since no lateral force absorbs the difference of the
    energies stored at both points. The generated energy equals this difference."""
    deep, down, up = 8e-3, np.linspace(0, 8e-3, 200), np.linspace(8e-3, 0, 200)

    def work(way):
        finger, total, before = Finger(0.0), 0.0, (0.0, 0.0)
        for x, e in way:
            force = finger.to(np.array([x, 0.3 * x, 0.0]), e)
            total += 0.5 * (force + before[0]) * (e - before[1])
            before = force, e
        return total

    for a, b in ((-0.02, 0.02), (0.025, 0.0)):
        held = [work([(x, e) for e in down]) for x in (a, b)]
        slid = work([(a, e) for e in down] + [(x, deep) for x in np.linspace(a, b, 200)] + [(b, e) for e in up])
        assert slid == approx(held[0] - held[1], abs=0.01 * held[0])


def test_arbitrary_loads_give_finite_results():
    it, rng = body(0.02), np.random.default_rng(2)
    mesh = organ().surface
    for _ in range(200):
        nodes = rng.choice(len(mesh.vertices), 5, replace=False).astype(np.int32)
        law = it.step(nodes, 3.0 * rng.standard_normal((5, 3)), tuple(mesh.vertices[0]), UP, 1e-2)
        assert np.isfinite(law).all() and law[0] > 0


def test_only_a_sticking_nonlinear_node_follows_large_displacement(monkeypatch, tmp_path):
    """At nu = 0.3 and a depth of half the radius a sticking surface has 7 to 9 % more force than the linear one, see
    tests/physics/bodies/test_large_displacement.py."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def indentation(force, **given):
        node = ReducedFE(surface="plane", coarse=80, poisson=0.3, vertices=2500, position=(0, 0, 0), **given)
        basis().save(tmp_path / "palpate/bases" / node.filename())
        bus, mesh = FakeBus(node), node.mesh()
        top = mesh.vertices[np.argmin(np.linalg.norm(mesh.vertices, axis=1))]
        q = np.linalg.norm(mesh.vertices - top, axis=1) / RADIUS
        nodes = np.flatnonzero(q < 1)
        share = (1 - q[nodes] ** 2) ** 2
        press = np.outer(share / share.sum(), (0, 0, -force))
        last = bus.publish(*[Load(nodes=nodes, forces=press, foot=top, normal=(0, 0, 1))] * 200)[-1]
        assert last.stiffness * (last.previous_indentation - last.rest_indentation) > 0
        return last.previous_indentation

    force = 1e-3 * 0.5 * RADIUS / indentation(1e-3)
    assert 1.06 < indentation(force, model="linear") / indentation(force) < 1.1
    assert indentation(force, sticks=False) == indentation(force, sticks=False, model="linear")


def test_beyond_the_deepest_press_the_body_stiffens():
    """The stiffness rises with each step of the force, and the body reports extrapolation."""
    foot, n, nodes, push = at_vertex(49)
    forces = np.geomspace(1.0, 1e4, 60)
    depth, beyond = [], []
    for force in forces:
        it = body()
        law = it.step(nodes, force * push, foot, n, 1e3)
        depth.append(law[2])
        beyond.append(it.extrapolation)
    depth, beyond = np.array(depth), np.array(beyond)
    assert (np.diff(depth) > 0).all() and beyond[0] == 0.0 and beyond[-1] > 0.3
    radius = depth[-1] / (DEEPEST * (1.0 + beyond[-1]))
    out = beyond > 0.0
    assert beyond[out] == approx(depth[out] / (radius * DEEPEST) - 1.0, rel=1e-6)
    assert (np.diff(depth[out]) / np.diff(forces[out]) > 0).all()
    assert (np.diff(np.diff(depth[out]) / np.diff(forces[out])) < 0).all()


def test_under_a_capsule_the_range_ends_at_a_smaller_depth():
    """0.3 instead of 1.5 radii of the load; a nodule elsewhere in the organ does not change the range."""
    foot, n, nodes, push = at_vertex(49)
    away, radii = np.full(len(basis().vertices), 0.02), []
    for force in (5.0, 8.0):
        found = []
        for apart in (None, away, 0.0 * away):
            it = CondensedBody(basis(), organ().surface, YOUNG, 0.0, RADIUS, 1.0, rho=RHO, apart=apart)
            found.append((it.step(nodes, force * push, foot, n, 1e3)[2], it.extrapolation))
        (depth, beyond), nodule, (same, covered) = found
        assert nodule == (depth, beyond) and same == depth and beyond == 0.0 < covered
        radii.append(depth / (0.3 * (1.0 + covered)))
    assert radii[0] == approx(radii[1], rel=1e-9) and RADIUS < radii[0] < 2.0 * RADIUS


def test_10_newtons_do_not_push_through_the_kidney():
    """The kidney is 42 mm thick; without a bound they would indent it by 34.6 mm."""
    node = ReducedFE(position=(0.0, 0.0, 0.0))
    bus, mesh = FakeBus(node), node.mesh()
    top = mesh.vertices[np.argmax(mesh.vertices[:, 2])]
    q = np.linalg.norm(mesh.vertices - top, axis=1) / 8e-3
    nodes = np.flatnonzero(q < 1)
    share = (1 - q[nodes] ** 2) ** 2
    surfaces = []
    for force in (0.5, 10.0):
        press = np.outer(share / share.sum(), (0, 0, -force))
        load = Load(nodes=nodes, forces=press, foot=tuple(top), normal=(0, 0, 1))
        surfaces.append(bus.publish(*[load] * 400)[-1])
    assert surfaces[0].extrapolation == 0.0
    assert surfaces[1].extrapolation > 0.5 and surfaces[1].previous_indentation < 25e-3
