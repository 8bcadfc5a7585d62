"""Contact of two deformable bodies (physics.contact.organs.between)."""

import numpy as np
import pytest
from pytest import approx
from scipy.optimize import nnls

from palpate.physics.contact.organs import between

RUNS = 120  # random motions
SIZE = 14


def bodies(rng, size=SIZE):
    """Compliances of two random bodies [m/N], positive definite."""
    found = []
    for _ in range(2):
        x = rng.uniform(0.0, 0.02, (size, 3))
        apart = np.linalg.norm(x[:, None] - x[None], axis=2)
        found.append(10.0 ** rng.uniform(-5, -2) * (np.exp(-apart / 8e-3) + 0.05 * np.eye(size)))
    return found


def outer(rng, steps, size=SIZE):
    """A random smooth motion of the candidates by other loads [m] (steps,2,size)."""
    shape = 2e-3 * rng.standard_normal((2, size)) - 1e-3
    phase = rng.uniform(0, 6, 2)
    times = np.arange(steps)[:, None, None]
    return shape * (1.0 - np.cos(0.05 * times * (1.0 + phase[:, None] / 6)))


def reference(gap, first, second, taus, motion, dt):
    """The same steps, each as a complementarity problem that non-negative least squares solves."""
    moved, forces = np.zeros((2, len(gap))), []
    share = [dt / (dt + tau) for tau in taus]
    factor = np.linalg.cholesky(share[0] * first + share[1] * second)
    for others in motion:
        rest = np.array([m * o + (1.0 - m) * u for m, o, u in zip(share, others, moved, strict=True)])
        p = nnls(factor.T, -np.linalg.solve(factor, gap + rest.sum(axis=0)), maxiter=5000)[0]
        moved = rest + np.array([share[0] * first @ p, share[1] * second @ p])
        forces.append(p)
    return np.array(forces)


def run(gap, first, second, taus, motion, dt=1e-3, most=between.MOST):
    made = between.pair(gap, first, second, taus)
    forces, openings, left = [], [], []
    for others in motion:
        left.append(between.step_pair(made, others, dt, most))
        forces.append(made.active.force.copy())
        openings.append(made.opening.copy())
    return np.array(forces), np.array(openings), np.array(left), made


def test_random_motions_agree_with_a_reference_and_generate_no_energy():
    rng = np.random.default_rng(5)
    pressed = 0
    for _ in range(RUNS):
        first, second = bodies(rng)
        gap, taus = rng.uniform(0, 1e-3, SIZE), 10.0 ** rng.uniform(-4, -1, 2)
        motion = outer(rng, 40)
        forces, openings, left, made = run(gap, first, second, taus, motion)
        assert not left.any() and forces.min() >= 0.0
        expected = reference(gap, first, second, taus, motion, 1e-3)
        assert forces == approx(expected, rel=1e-5, abs=1e-8 * max(expected.max(), 1e-12))
        assert openings.min() > -1e-9 and np.abs(forces * openings).max() < 1e-12 * max(forces.max(), 1.0)
        assert (
            made.past["generated"][0] <= 1e-9 * made.past["dissipated"][0] + 1e-15
        )  # [J] rounding of the gap times the force
        pressed += forces.any()
    assert pressed > RUNS // 2


def test_exchanged_bodies_have_the_same_bits():
    rng = np.random.default_rng(6)
    for _ in range(10):
        first, second = bodies(rng)
        gap, motion = rng.uniform(0, 1e-3, SIZE), outer(rng, 40)
        one = run(gap, first, second, (0.02, 0.005), motion)
        other = run(gap, second, first, (0.005, 0.02), motion[:, ::-1])
        assert np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1])


def test_bodies_apart_have_no_force():
    first, second = bodies(np.random.default_rng(7))
    motion = outer(np.random.default_rng(8), 40)
    forces, openings, _, _ = run(np.full(SIZE, 1.0), first, second, (0.02, 0.02), motion)
    assert not forces.any() and openings.min() > 0.9


def test_a_bounded_step_never_pulls_and_counts_what_it_generates():
    """With one change per step overlaps are left; the energy that they return is counted."""
    rng = np.random.default_rng(9)
    first, second = bodies(rng)
    motion = outer(rng, 200)
    gap = np.full(SIZE, 2e-4)
    forces, openings, left, made = run(gap, first, second, (0.02, 0.02), motion, most=1)
    assert left.any() and forces.min() >= 0.0
    work = (forces * np.diff(openings, axis=0, prepend=gap[None])).sum(axis=1)
    assert made.past["generated"][0] == approx(work[work > 0].sum(), abs=1e-15)
    assert made.past["dissipated"][0] == approx(-work[work < 0].sum(), abs=1e-15)


@pytest.mark.parametrize("body", [0, 1])
def test_the_responses_are_the_derivatives_of_the_lifts_by_each_finger(body):
    """y_ij by differences of two steps with different forces of three fingers and the same active candidates."""
    rng = np.random.default_rng(10)
    first, second = bodies(rng)
    gap = rng.uniform(0, 1e-5, SIZE)
    opened = -rng.uniform(1e-5, 1e-4, (3, SIZE))  # by 1 N
    taus, forces = (0.02, 0.004), np.array([2.0, 0.5, 1.0])
    own, by = (dt := 1e-3) / (dt + taus[body]), 1e-6

    def step(last):
        """The state after five steps under `forces` and one under `last`."""
        made, others = between.pair(gap, first, second, taus), np.zeros((2, SIZE))
        for given in (*[forces] * 5, last):
            others[body] = given @ opened
            between.step_pair(made, others, dt, 10_000)
        return made

    found, along = np.zeros((3, 3)), np.zeros((2, 3, SIZE))
    base, given = step(forces), forces[:, None] * opened
    part = given * rng.uniform(0.7, 1.3, given.shape)  # without friction
    between.responses(base, base.active, 0, body, given, given, forces, dt, along, found)
    assert np.array_equal(found, found.T) and np.linalg.eigvalsh(found).min() > -1e-12
    between.responses(base, base.active, 0, body, given, part, forces, dt, along, found)
    for j in range(3):
        change = step(forces + by * np.eye(3)[j]).active.force - base.active.force
        assert own * (part / forces[:, None] @ change) / by == approx(-found[:, j], rel=1e-4)
    light = np.array([2.0, 1e-7, 1.0])
    between.responses(base, base.active, 0, body, given, given, light, dt, along, found)
    assert not found[1].any() and not found[:, 1].any()


def test_the_opening_by_a_load_is_the_sum_over_its_terminals():
    rng = np.random.default_rng(11)
    corners, weights = rng.integers(0, 9, (50, 3)), rng.uniform(0, 1, (50, 3))
    compliance, nodes = rng.standard_normal((27, SIZE)), rng.choice(50, 12, replace=False).astype(np.int32)
    forces, out, blocks = rng.standard_normal((12, 3)), np.zeros(SIZE), between.blocks_of(compliance)
    gathered, touched, part = np.zeros((9, 3)), np.zeros((2, 9), np.int64), np.zeros(SIZE)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    between.open_by(nodes, forces, tuple(n), corners, weights, blocks, gathered, touched, out, part)
    for found, loads in ((out, forces), (part, np.outer(forces @ n, n))):
        expected = np.zeros(SIZE)
        for node, force in zip(nodes, loads, strict=True):
            for corner, weight in zip(corners[node], weights[node], strict=True):
                expected += weight * force @ compliance[3 * corner : 3 * corner + 3]
        assert found == approx(expected, rel=1e-12, abs=1e-13)
    assert not gathered.any() and not touched[1].any()
