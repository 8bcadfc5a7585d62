"""Linear complementarity by block pivoting (physics.contact.organs.pivoting) against non-negative least squares."""

import numpy as np
import pytest
from pytest import approx
from scipy.optimize import nnls

from palpate.physics.contact.organs import pivoting
from palpate.physics.contact.organs.pivoting import active_set, complement

PROBLEMS = 400  # random problems


def problem(rng, size):
    """A random positive definite matrix, of a condition up to 1e4, and gaps of both signs."""
    q, _ = np.linalg.qr(rng.standard_normal((size, size)))
    matrix = (q * 10.0 ** rng.uniform(-4, 0, size)) @ q.T
    return np.ascontiguousarray(0.5 * (matrix + matrix.T)), rng.standard_normal(size)


def reference(matrix, gap):
    """p by Lawson and Hanson's non-negative least squares: min |U p + U'^-1 g|² has the same conditions."""
    factor = np.linalg.cholesky(matrix)
    return nnls(factor.T, -np.linalg.solve(factor, gap), maxiter=100 * len(gap))[0]


def test_random_problems_agree_with_nonnegative_least_squares():
    rng = np.random.default_rng(81)
    for _ in range(PROBLEMS):
        matrix, gap = problem(rng, int(rng.integers(1, 40)))
        active = active_set(len(gap))
        assert complement(matrix, gap, active, 10_000) == 0
        expected = reference(matrix, gap)
        assert active.force == approx(expected, rel=1e-6, abs=1e-7 * max(expected.max(), 1e-9))
        slack = gap + matrix @ active.force
        assert slack.min() > -1e-9 * np.abs(gap).max() and abs(active.force @ slack) < 1e-9 * (1.0 + active.force.sum())


def test_a_changing_contact_is_solved_from_the_last_set():
    """A sequence of slowly changing gaps: the updated factor stays that of the set, and most calls take one round."""
    rng = np.random.default_rng(2)
    matrix, gap = problem(rng, 30)
    matrix += 0.5 * np.eye(30)
    drift, active, rounds = rng.standard_normal(30), active_set(30), []
    for step in range(300):
        now = gap + 2.0 * np.sin(0.02 * step) * drift
        assert complement(matrix, now, active, 10_000) == 0
        assert active.force == approx(reference(matrix, now), rel=1e-7, abs=1e-9)
        rounds.append(active.tally["rounds"][0])
        used = active.order[: active.tally["active"][0]]
        factor = np.triu(active.factor[: len(used), : len(used)])
        assert factor.T @ factor == approx(matrix[np.ix_(used, used)], rel=1e-9, abs=1e-11)
    assert np.median(rounds) == 1


@pytest.mark.parametrize("most", [1, 4])
def test_a_bounded_call_never_pulls_and_later_calls_reach_the_solution(most):
    rng = np.random.default_rng(3)
    for _ in range(50):
        matrix, gap = problem(rng, 25)
        active, calls, left = active_set(25), 0, 1
        while left and calls < 1000:
            left = complement(matrix, gap, active, most)
            calls += 1
            assert active.tally["changes"][0] <= most and active.force.min() >= 0.0
        assert left == 0 and active.force == approx(reference(matrix, gap), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("seed", range(12))
def test_a_bounded_call_in_which_candidates_part_generates_no_energy(seed):
    """Bodies whose compliance decreases with the distance part by more candidates than a call releases. The contact may
    give them no work: the forces of the others, solved with the pull of those that are left, did 0.5 to 7 times the
    energy that the forces before had stored."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 10.0, (40, 2))
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    matrix, pressed = np.exp(-away / 3.0) + 0.05 * np.eye(40), active_set(40)
    gap = -rng.uniform(0.5, 1.0, 40)
    assert complement(matrix, gap, pressed, 1000) == 0
    opening = gap + matrix @ pressed.force
    lifted = gap + rng.uniform(0.3, 1.2, 40)
    assert complement(matrix, lifted, pressed, 4) > 5
    work = pressed.force @ (lifted + matrix @ pressed.force - opening)
    assert pressed.force.min() >= 0.0 and pressed.force.max() > 0.0
    assert work < 1e-6


def test_two_candidates_at_one_place_carry_the_force_of_one():
    """A singular matrix: the second of two equal candidates stays free, at the gap 0."""
    active = active_set(2)
    assert complement(np.ones((2, 2)), np.array([-1.0, -1.0]), active, 10) == 0
    assert sorted(active.force) == [0.0, 1.0]


def test_the_factor_of_a_changed_matrix_is_computed_again():
    rng = np.random.default_rng(4)
    matrix, gap = problem(rng, 12)
    active = active_set(12)
    complement(matrix, gap, active, 1000)
    pivoting.refactor(3.0 * matrix, active)
    assert complement(3.0 * matrix, gap, active, 1000) == 0 and active.tally["changes"][0] == 0
    assert active.force == approx(reference(matrix, gap) / 3.0, rel=1e-7, abs=1e-9)
