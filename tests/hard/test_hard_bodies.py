"""Hard cases of bodies: locking, inverted and sliver elements, steps without bound."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pressing import NodalBody, Spreader
from pytest import approx

from palpate.models.fe import Material, MeshError, Settings, Solver, box, linear, neo_hooke, quadratic
from palpate.models.fe.element.mesh import bricks, grid
from palpate.models.fe.solve.body import ElasticBody
from palpate.physics.errors import PalpateError
from palpate.physics.geometry.mesh import plane

UP = (0.0, 0.0, 1.0)
steps = st.floats(-6, 1).map(lambda e: 10.0**e)
MESH = plane(0.04, 21**2)
SPREADER = Spreader(MESH, 8e-3)


def linear_tetrahedra(points, tets, young, poisson, fixed, push):
    """The usual method: displacements [m] (N,3) of straight four-node tetrahedra under small strain."""
    mu, lame = young / (2 + 2 * poisson), young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    stiffness = np.zeros((3 * len(points), 3 * len(points)))
    for tet in tets:
        edges = np.concatenate([np.ones((4, 1)), points[tet]], axis=1)
        slope, volume = np.linalg.inv(edges)[1:].T, abs(np.linalg.det(edges)) / 6
        same = slope @ slope.T
        block = mu * (np.einsum("ab,ij->aibj", same, np.eye(3)) + np.einsum("aj,bi->aibj", slope, slope))
        block += lame * np.einsum("ai,bj->aibj", slope, slope)
        where = (3 * tet[:, None] + np.arange(3)).ravel()
        stiffness[np.ix_(where, where)] += volume * block.reshape(12, 12)
    free, u = ~fixed.ravel(), np.zeros(3 * len(points))
    u[free] = np.linalg.solve(stiffness[np.ix_(free, free)], push.ravel()[free])
    return u.reshape(-1, 3)


def pressed(poisson, cells, plain):
    """Mean sinking [m] under a patch of load on a block that is held at its bottom and between smooth walls."""
    mesh = box((0.04, 0.04, 0.02), (cells, cells, cells // 2))
    corners = np.unique(mesh.elements[:, :4])
    number = np.full(len(mesh.points), -1)
    number[corners] = np.arange(len(corners))
    points = mesh.points[corners] if plain else mesh.points
    x, y, z = points.T
    wall = [(np.abs(a) < 1e-9) | (np.abs(a - 0.04) < 1e-9) for a in (x, y)]
    bottom = z < 1e-9
    fixed = np.stack([bottom | wall[0], bottom | wall[1], bottom], axis=1)
    loaded = (z > 0.02 - 1e-9) & (x < 0.02 + 1e-9)
    # The same pressure in both: each corner of the grid takes its share, quadratic nodes between them none.
    shares = np.where(loaded & (np.isin(np.arange(len(points)), corners) | plain), 1.0, 0.0)
    for a, edges in ((x, (0.0, 0.02)), (y, (0.0, 0.04))):
        for edge in edges:
            shares[np.abs(a - edge) < 1e-9] *= 0.5
    push = -np.outer(shares / shares.sum(), UP)
    if plain:
        u = linear_tetrahedra(points, number[mesh.elements[:, :4]], 1e4, poisson, fixed, push)
    else:
        body = Solver(
            mesh, {0: linear(1e4, poisson)}, fixed, loads=lambda load: load * push, settings=Settings(step=1.0)
        )
        body.advance(1.0)
        u = body.displacement
    return float((u * push).sum() / (push**2).sum() ** 0.5)


def test_linear_tetrahedra_lock_where_the_mixed_element_does_not():
    """A nearly incompressible block with a load on half of its top. From Poisson's ratio 0.49 to 0.4999 the true
    displacement hardly changes; that of linear tetrahedra falls (locking), since each has to keep its volume."""
    usual = [pressed(nu, 4, plain=True) for nu in (0.3, 0.4999)]
    ours = [pressed(nu, 4, plain=False) for nu in (0.3, 0.4999)]
    finer = pressed(0.4999, 6, plain=False)
    assert usual[1] < 0.01 * usual[0] and ours[1] > 0.5 * ours[0]
    assert ours[1] == approx(finer, rel=0.25)


def test_plain_elements_are_refused_where_they_would_lock():
    law = linear(1e4, 0.4999)
    fixed = np.zeros((27, 3), dtype=bool)
    with pytest.raises(PalpateError, match="lock"):
        Solver(box((1.0, 1.0, 1.0), (1, 1, 1)), {0: Material(law.law, law.parameters, small=True)}, fixed)


def test_an_element_that_is_pushed_inside_out_is_refused_and_its_energy_stays_finite():
    """The usual small-strain energy is finite and wrong there: it has no idea of inside out, and lets an element pass
    through itself. Here the step is refused and halved, and the solver gives up with a reason where none is left."""
    mesh = box((0.01, 0.01, 0.01), (1, 1, 1))
    body = ElasticBody(mesh, {0: neo_hooke(1e4, 0.3)})
    through = -1.2 * mesh.points * (0, 0, 1)
    assert body.balance(through) is None
    z = mesh.points[:, 2]
    fixed = np.repeat(((z < 1e-9) | (z > 0.01 - 1e-9))[:, None], 3, axis=1)
    solver = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, fixed, lambda load: load * through)
    with pytest.raises(PalpateError) as raised:
        solver.advance(1.0)
    assert np.isfinite(solver.displacement).all() and len(str(raised.value)) > 40


@settings(deadline=None, max_examples=20)
@given(st.floats(-9, -1), st.integers(0, 2**31))
def test_slivers_give_finite_forces_or_are_named_in_an_error(flatness, seed):
    """A corner is moved towards the opposite face until hardly anything of an element is left."""
    x = np.linspace(0.0, 0.01, 3)
    points, cells = grid(x, x, x)
    rng = np.random.default_rng(seed)
    middle = np.argmin(np.linalg.norm(points - 0.005, axis=1))
    points[middle, 2] = 0.005 * 10.0**flatness
    try:
        mesh = quadratic(points, bricks(points, cells))
        body = ElasticBody(mesh, {0: neo_hooke(1e4, 0.3)})
    except MeshError as error:
        assert "element" in str(error)
        return
    u = 1e-6 * rng.normal(size=mesh.points.shape)
    balanced = body.balance(u)
    assert balanced is None or (math.isfinite(balanced[0]) and np.isfinite(balanced[1]).all())
    assert body.balance(np.zeros_like(u))[1] == approx(np.zeros_like(u), abs=1e-12)


def load(force):
    count = SPREADER.spread((0.0, 0.0, 0.0), UP, force)
    return SPREADER.nodes[:count].copy(), SPREADER.forces[:count].copy()


NOTHING = (np.zeros(0, np.int32), np.zeros((0, 3)))


@settings(deadline=None, max_examples=20)
@given(st.lists(st.tuples(st.floats(0, 30), st.floats(-10, 10)), min_size=1, max_size=6), steps)
def test_a_body_under_any_load_and_step_stays_within_the_static_answer(pushes, dt):
    """Loads to 30 N, reversed sideways, steps of 1 us to 10 s: no node is deeper than under the greatest load at rest.
    After the release each node recovers without overshoot."""
    deepest = (max(p for p, _ in pushes) / 3e3) ** (1 / 1.5)
    body = NodalBody(MESH, 3e3, 1.5, 5.0, 300.0, 3.0)
    for push, aside in pushes:
        nodes, u = body.step(*load((aside, 0.0, -push)), UP, dt)
        assert np.isfinite(u).all() and (u.size == 0 or -u[:, 2].min() <= deepest + 1e-9)
    depth = math.inf
    for _ in range(20):
        nodes, u = body.step(*NOTHING, UP, dt)
        now = max(float(-u[:, 2].min()), 0.0) if len(nodes) else 0.0
        assert now <= depth + 1e-9 and (u.size == 0 or u[:, 2].max() <= 1e-9)
        depth = now


def test_explicit_springs_diverge_where_the_implicit_step_does_not():
    """The same spring and dashpot at a node, k u + d u' = f by explicit Euler: it needs k T/d < 2 and is beyond from
    20 ms on. The implicit step is at the static answer."""
    k, d, f, dt = 300.0, 3.0, 1.0, 0.03
    usual = 0.0
    for _ in range(60):
        usual += dt * (f - k * usual) / d
    assert abs(usual) > 1e6 * f / k
    body = NodalBody(MESH, 3e3, 1.5, 5.0, k, d)
    for _ in range(60):
        _, u = body.step(*load((f, 0.0, -1.0)), UP, dt)
    assert np.isfinite(u).all() and 0.0 < u[:, 0].max() <= f / k * 1.01
