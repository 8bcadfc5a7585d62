"""What large displacement adds to the condensed organ: against the full model, and as a body that stays passive."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx
from scipy.optimize import brentq

from palpate.fe.curves import continued, dent_table, dents, patch, pressed_places, scattered, spread_out
from palpate.fe.organ import Organ
from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.surface import surface_mesh
from palpate.physics.contact import exponential, series
from palpate.physics.dents import SPACING, hat_moments, patch_radius, rise, risen
from palpate.physics.reduced_fe import Basis, CondensedBody
from palpate.physics.terminal import Terminal

YOUNG = 2e4
RADIUS = 12e-3
PRESSED = 9
UP = (0.0, 0.0, 1.0)
SHAPE = ("plane", 80)


@lru_cache
def organ():
    return Organ(surface_mesh(*SHAPE))


@lru_cache
def basis():
    mesh = organ().surface
    table = dent_table(organ(), PRESSED, RADIUS, levels=3)
    return Basis(mesh.vertices, mesh.triangles, organ().compliance().astype(np.float32), table)


def body(retardation=0.0, dented=True):
    given = basis() if dented else Basis(basis().vertices, basis().triangles, basis().compliance)
    return CondensedBody(given, organ().surface, YOUNG, retardation, RADIUS, 1.0)


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


def full_indentation(nodes, push, *forces):
    """Of the nonlinear model under growing forces."""
    load = np.zeros((1, len(organ().surface.vertices), 3))
    load[0, nodes] = push
    (found,) = dents(organ(), load, np.array([forces]) / YOUNG)
    straight_on = float(load.ravel() @ (organ().compliance() @ load.ravel())) / YOUNG
    return straight_on * np.array(forces) + found


def unseen(count):
    """Random places well inside the slab: foot point, normal, nodes and forces of a unit load."""
    rng = np.random.default_rng(6)
    for _ in range(count):
        foot = np.array([*rng.uniform(-0.03, 0.03, 2), 0.0])
        yield tuple(foot.tolist()), UP, *unit(foot, np.array(UP))


@pytest.mark.long
def test_dents_are_what_newton_finds_beyond_the_linear_organ():
    _, _, nodes, push = at_vertex(40)
    load = np.zeros((len(organ().surface.vertices), 3))
    load[nodes] = push
    hats = organ().hats()
    model = organ().full(YOUNG, lambda f: f * (hats @ load))
    # elements below 2 % of strain count as linear: half a per cent is what is claimed
    for force, found in zip((0.4, 0.8), full_indentation(nodes, push, 0.4, 0.8), strict=True):
        model.advance(force)
        assert found == approx(float(np.sum(load * (hats.T @ model.displacement))), rel=5e-3)


def test_where_the_organ_was_pressed_the_body_repeats_the_full_model():
    feet, normals = pressed_places(organ().surface, PRESSED, RADIUS)
    k = int(np.argmax(normals[:, 2]))
    nodes, push = unit(feet[k], normals[k])
    forces = (0.4, 0.8)
    for force, truth in zip(forces, full_indentation(nodes, push, *forces), strict=True):
        found = settled(body(), tuple(feet[k]), tuple(normals[k]), nodes, push, force)[2]
        assert found == approx(truth, rel=5e-3)


def test_where_it_was_not_pressed_the_error_is_below_two_percent_and_a_fraction_of_the_linear_ones():
    missed, linear = [], []
    for foot, n, nodes, push in unseen(4):
        truth = full_indentation(nodes, push, 0.5, 1.0)[1]
        missed.append(abs(settled(body(), foot, n, nodes, push, 1.0)[2] / truth - 1))
        linear.append(abs(settled(body(dented=False), foot, n, nodes, push, 1.0)[2] / truth - 1))
    assert max(missed) < 0.02
    assert max(missed) < 0.5 * max(linear)


def test_a_light_touch_is_linear():
    foot, n, nodes, push = at_vertex(40)
    a, b = (settled(body(dented=d), foot, n, nodes, push, 1e-3)[2] for d in (True, False))
    assert a == approx(b, rel=1e-3)


def test_half_the_modulus_under_half_the_force_indents_the_same():
    foot, n, nodes, push = at_vertex(40)
    one = settled(body(), foot, n, nodes, push, 1.5)[2]
    soft = CondensedBody(basis(), organ().surface, YOUNG / 2, 0.0, RADIUS, 1.0)
    assert soft.step(nodes, 0.75 * push, foot, n, 1e3)[2] == approx(one, rel=1e-9)


def test_the_mean_displacement_of_the_patch_is_the_indentation():
    foot, n, nodes, push = at_vertex(49)
    it = body()
    s = settled(it, foot, n, nodes, push, 1.4)[2]
    found, moved = it.displaced(foot)
    u = np.zeros_like(organ().surface.vertices)
    u[found] = moved
    assert np.sum(push * u[nodes]) == approx(s, rel=1e-5)


def test_random_presses_at_a_place_never_give_back_more_than_they_took():
    """The stored energy is the Legendre transform of V*, its derivative the indentation: so it is the integral of f ds
    at rest."""
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
def test_a_closed_cycle_of_indentation_against_a_finger_costs_energy(dt):
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
    assert f == 0.0
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


def test_a_loaded_finger_that_slides_meets_no_jump():
    mesh = surface_mesh("plane", 2500)
    it, found = CondensedBody(basis(), mesh, YOUNG, 0.02, RADIUS, 1.0), []
    for x in np.linspace(-0.02, 0.02, 801):
        foot = np.array([x, 0.3 * x, 0.0])
        q = np.linalg.norm(mesh.vertices - foot, axis=1) / RADIUS
        nodes = np.flatnonzero(q < 1).astype(np.int32)
        share = (1 - q[nodes] ** 2) ** 2
        found.append(it.step(nodes, np.outer(share / share.sum(), (0, 0, -2.5)), tuple(foot), UP, 1e-3))
    later = np.array(found[200:])
    assert (np.abs(np.diff(later, axis=0)).max(axis=0) < 0.01 * later.mean(axis=0)).all()


def test_unknown_scraps_of_load_stay_finite():
    it, rng = body(0.02), np.random.default_rng(2)
    mesh = organ().surface
    for _ in range(200):
        nodes = rng.choice(len(mesh.vertices), 5, replace=False).astype(np.int32)
        law = it.step(nodes, 3.0 * rng.standard_normal((5, 3)), tuple(mesh.vertices[0]), UP, 1e-2)
        assert np.isfinite(law).all() and law[0] > 0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=8), st.floats(1e-3, 10))
def test_the_response_rises_whatever_the_dents(values, linear):
    knots, slopes = np.zeros(len(values) + 1), np.zeros(len(values) + 1)
    share = np.array([[1.0]])
    rise(np.array([values]), np.zeros(1), 1, share, linear, knots, slopes)
    p = np.linspace(-0.1, SPACING * (len(values) + 2), 400)
    s = np.array([risen(x, knots, slopes) for x in p])
    assert (np.diff(s[:, 0]) > 0).all()
    assert (s[:, 1] >= -1e-12).all()
    h = 1e-7
    slope = [(risen(x + h, knots, slopes)[0] - risen(x - h, knots, slopes)[0]) / (2 * h) for x in p]
    assert slope == approx(s[:, 1], abs=1e-3 * s[:, 1].max())


def test_smooth_dents_are_followed_between_their_levels():
    levels = SPACING * np.arange(1, 8)
    knots, slopes = np.zeros(8), np.zeros(8)
    rise((0.4 * levels**3)[None], np.zeros(1), 1, np.array([[1.0]]), 0.8, knots, slopes)
    p = np.linspace(0, 0.7, 100)
    found = np.array([risen(x, knots, slopes)[0] for x in p])
    assert found == approx(0.8 * p + 0.4 * p**3, abs=1e-3)


def test_a_patch_has_the_radius_of_its_pressure():
    mesh = surface_mesh("plane", 4000)
    every = np.arange(len(mesh.vertices))
    for radius in (6e-3, 15e-3):
        share = patch(mesh, np.zeros(3), np.array([0, 0, 1.0]), radius)
        found = patch_radius(mesh.vertices, hat_moments(mesh), every, len(every), -share[:, 2:])
        assert found == approx(radius, rel=0.12 if radius < 0.01 else 0.03)
        assert share.sum(axis=0) == approx([0, 0, -1])


def test_the_moment_of_a_hat_is_its_mean_square_distance():
    mesh = organ().surface
    rng = np.random.default_rng(0)
    v = 31
    total = weight = 0.0
    for tri in mesh.triangles[(mesh.triangles == v).any(axis=1)]:
        x = mesh.vertices[tri]
        area = np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0]))
        w = rng.dirichlet((1, 1, 1), 40000)
        hat = w[:, list(tri).index(v)]
        away = np.sum((w @ x - mesh.vertices[v]) ** 2, axis=1)
        total += area * np.mean(hat * away)
        weight += area * np.mean(hat)
    assert hat_moments(mesh)[v] == approx(total / weight, rel=0.02)


def test_values_are_carried_over_the_surface_and_kept_where_they_were_found():
    mesh = organ().surface
    chosen = scattered(mesh.vertices, 20, 12e-3)
    shares = np.stack([-patch(mesh, mesh.vertices[v], mesh.normals[v], 12e-3) @ mesh.normals[v] for v in chosen])
    values = np.stack([np.ones(20), shares @ mesh.vertices[:, 0]], axis=1)
    found = spread_out(mesh.vertices, shares, values)
    assert found[:, 0] == approx(np.ones(len(mesh.vertices)))
    assert shares @ found == approx(values)
    assert found[:, 1] == approx(mesh.vertices[:, 0], abs=5e-3)


def test_levels_that_were_not_reached_go_on_as_the_last_two_went():
    levels = np.array([1.0, 2.0, 3.0, 4.0])
    lost = np.array([[1, 4, np.nan, np.nan], [0.5, np.nan, np.nan, np.nan], [-1, -3, np.nan, 0], [np.nan] * 4])
    expected = np.array([[1, 4, 9, 16], [0.5, 1, 1.5, 2], [-1, -3, -5, -7], [0, 0, 0, 0]])
    assert continued(levels, lost) == approx(expected)
    assert continued(levels, np.array([[1e-6, 1.0, np.nan, np.nan]]))[0, 2:] == approx([1.5**3, 2.0**3])


def test_a_basis_without_dents_serves_the_linear_model_only(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    node = ReducedFE(surface="plane", coarse=80, model="linear")
    given = basis()
    Basis(given.vertices, given.triangles, given.compliance).save(tmp_path / "palpate/bases" / f"{node.key()}.npz")
    FakeBus(node)
    with pytest.raises(SettingError, match="palpate reduce"):
        FakeBus(ReducedFE(surface="plane", coarse=80))


def test_the_node_is_softer_than_its_linear_model_under_a_hard_press(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found = []
    for model in ("nonlinear", "linear"):
        node = ReducedFE(surface="plane", coarse=80, model=model, vertices=400, position=(0, 0, 0))
        basis().save(tmp_path / "palpate/bases" / f"{node.key()}.npz")
        bus, mesh = FakeBus(node), node.mesh()
        top = mesh.vertices[np.argmin(np.linalg.norm(mesh.vertices, axis=1))]
        q = np.linalg.norm(mesh.vertices - top, axis=1) / RADIUS
        nodes = np.flatnonzero(q < 1)
        share = (1 - q[nodes] ** 2) ** 2
        press = np.outer(share / share.sum(), (0, 0, -1.5))
        last = bus.publish(*[Load(nodes=nodes, forces=press, foot=top, normal=(0, 0, 1))] * 200)[-1]
        assert last.stiffness * (last.previous - last.free) > 0
        found.append(last.previous)
    assert found[0] > 1.01 * found[1]
