"""Newton's direction with a factorization in single precision, reused in later iterations, against dense solutions."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import Solver, neo_hooke
from palpate.models.fe.element.mesh import box
from palpate.models.fe.solve.body import ElasticBody
from palpate.models.fe.sparse import ordering, tangent
from palpate.models.fe.sparse.ordering import dissect
from palpate.models.fe.sparse.tangent import ENOUGH, SKEW, Tangent, descend


def nothing(change):
    return np.zeros_like(change)


def held_block(cells=3, poisson=0.45):
    mesh = box((0.03, 0.02, 0.02), (cells, cells, cells))
    body = ElasticBody(mesh, {0: neo_hooke(1e4, poisson)})
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    rng = np.random.default_rng(4)
    rhs = np.where(fixed, 0.0, rng.standard_normal(mesh.points.shape))
    return mesh, body, fixed, rhs


def dense(made, data, unsymmetric=0.0):
    blocks = data.copy()
    made.hold(blocks)
    return made.pattern.matrix(blocks).toarray() + unsymmetric


@pytest.fixture
def factored(monkeypatch):
    """How often a tangent is factored in single and in double precision."""
    counts = {"single": 0, "double": 0}
    factor = tangent.Cholesky.factor

    def counted(self, data):
        counts["single" if self.dtype == np.float32 else "double"] += 1
        factor(self, data)

    monkeypatch.setattr(tangent.Cholesky, "factor", counted)
    return counts


def test_directions_keep_their_residual_bound_and_the_factor_is_reused_while_useful(factored):
    mesh, body, fixed, rhs = held_block()
    made = Tangent(mesh.points, mesh.elements, fixed)
    shear = np.outer(mesh.points[:, 2], (1.0, 0.5, -0.3))
    for change, anew in ((0.0, 1), (0.02, 1), (0.04, 1)):  # a little at a time: one factor does for all
        data = body.tangent(change * shear)
        step = made.direction(data, rhs, nothing)
        left = dense(made, data) @ step.ravel() - rhs.ravel()
        assert np.linalg.norm(left) <= 1.01 * ENOUGH * np.linalg.norm(rhs)
        assert factored == {"single": anew, "double": 0}
    stiff = body.tangent(np.zeros_like(rhs))
    stiff[made.diagonal[::2]] += 50.0 * np.abs(stiff).max() * np.diag((0.0, 0.0, 1.0))  # as points that come to touch
    step = made.direction(stiff, rhs, nothing)
    left = dense(made, stiff) @ step.ravel() - rhs.ravel()
    assert np.linalg.norm(left) <= 1.01 * ENOUGH * np.linalg.norm(rhs)
    assert factored == {"single": 2, "double": 0}
    made.forget()
    made.direction(stiff, rhs, nothing)
    assert factored == {"single": 3, "double": 0}


@pytest.mark.parametrize("kept", [False, True])
def test_the_unsymmetric_part_is_solved_with_any_factor(kept):
    mesh, body, fixed, rhs = held_block()
    made = Tangent(mesh.points, mesh.elements, fixed)
    data = body.tangent(np.zeros_like(rhs))
    if kept:
        made.direction(body.tangent(0.1 * np.outer(mesh.points[:, 2], (1.0, 0.0, 0.0))), rhs, nothing)
    rng = np.random.default_rng(7)
    top = np.flatnonzero(mesh.points[:, 2] > 0.02 - 1e-9)
    row, column = np.zeros(rhs.size), np.zeros(rhs.size)
    row[3 * top], column[3 * top + 2] = rng.uniform(0.5, 1.0, len(top)), rng.uniform(0.5, 1.0, len(top))
    part = 0.3 * float(np.abs(data).max()) * np.outer(row, column)  # friction that grows with pressure
    step = made.direction(data, rhs, lambda change: (part @ change.ravel()).reshape(-1, 3))
    exact = np.linalg.solve(dense(made, data, part), rhs.ravel())
    without = np.linalg.solve(dense(made, data), rhs.ravel())
    assert np.linalg.norm(step.ravel() - exact) < 5.0 * SKEW * np.linalg.norm(exact)
    assert np.linalg.norm(without - exact) > 20.0 * SKEW * np.linalg.norm(exact)


def bent(slices):
    """A bar of 1 mm x 1 mm under a force at its end, by Euler and Bernoulli's deflection of 1 % of its length."""
    length, young = 1e-3 * slices, 1e4
    mesh = box((length, 1e-3, 1e-3), (slices, 1, 1))
    end = mesh.points[:, 0] > length - 1e-12
    force = 0.01 * 3.0 * young * 1e-12 / 12.0 / length**2
    tip = np.zeros_like(mesh.points)
    tip[end, 2] = force / end.sum()
    fixed = np.repeat(mesh.points[:, :1] < 1e-12, 3, axis=1)
    body = Solver(mesh, {0: neo_hooke(young, 0.3)}, fixed, loads=lambda load: load * tip)
    body.advance(1.0)
    return float(body.displacement[end, 2].mean()) / (0.01 * length), body.iterations


def test_double_precision_is_used_where_single_precision_cannot_factor(factored):
    """The condition of a bar of 400 slices is some 1e10."""
    deflection, iterations = bent(400)
    assert deflection == approx(1.0, abs=5e-3)
    assert factored["double"] > 0.7 * iterations
    assert factored["single"] < iterations  # given up for the rest of a load step
    factored["double"] = 0
    assert bent(8)[0] == approx(1.0, abs=0.04)
    assert factored["double"] == 0


def test_conjugate_gradients_end_where_they_do_not_pay():
    rng = np.random.default_rng(2)
    n = 400
    vectors, _ = np.linalg.qr(rng.standard_normal((n, n)))
    rhs, seen = rng.standard_normal(n), []

    def same(r):
        seen.append(1)
        return r

    matrix = (vectors * np.geomspace(1.0, 1e6, n)) @ vectors.T
    x, done = descend(matrix, rhs, np.zeros(n), same, 1e-6, 50)
    assert not done and len(seen) <= 5
    matrix = (vectors * np.linspace(1.0, 1.2, n)) @ vectors.T
    x, done = descend(matrix, rhs, np.zeros(n), same, 1e-6, 50)
    assert done and np.linalg.norm(matrix @ x - rhs) <= 1e-6 * np.linalg.norm(rhs)
    near, done = descend(matrix, rhs, x, same, 1e-3, 50)
    assert done and near is x
    assert not descend(-matrix, rhs, np.zeros(n), same, 1e-6, 50)[1]
    x, done = descend(matrix, np.zeros(n), np.zeros(n), same, 1e-6, 50)
    assert done and not x.any()


@pytest.mark.parametrize("shape", [(6, 6, 6), (14, 4, 3)])
def test_the_tried_directions_reduce_the_residual_about_as_well_as_all(shape, monkeypatch):
    mesh = box((0.01 * shape[0], 0.01 * shape[1], 0.01 * shape[2]), shape)
    turned = mesh.points @ np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    sparsity = tangent.pattern(len(mesh.points), mesh.elements)

    def work():
        tree = dissect(turned, sparsity.indptr, sparsity.indices)
        pivots, rows = np.diff(tree.first), np.diff(tree.start)
        return float(np.sum(pivots**3 / 3 + pivots**2 * rows + pivots * rows**2))

    few = work()
    monkeypatch.setattr(ordering, "TRIED", len(ordering.DIRECTIONS))
    assert few < 1.15 * work()
