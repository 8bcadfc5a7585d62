"""The search of least squares with secant updates, against minima known from elsewhere, and its number of runs."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.studies.inverse.descent import Descent, Point

T = np.linspace(0.0, 2.0, 200)
NOISE = 0.03 * np.random.default_rng(0).standard_normal(len(T))


class Counted:
    """Residuals that count their calls."""

    def __init__(self, law, count):
        self.law, self.count, self.runs = law, count, 0

    def __call__(self, x):
        self.runs += 1
        return self.law(x)

    def slopes(self, x, r):
        moved = [self(x + 1e-6 * row) for row in np.eye(self.count)]
        return np.array([(each - r) / 1e-6 for each in moved]).T

    def search(self, begin, tolerance=1e-10, low=-10.0, high=10.0, renew=True):
        begin, edges = np.array(begin, float), np.ones(self.count)
        descent = Descent(self, self.slopes, low * edges, high * edges, edges)
        r = self(begin)
        return descent.run(Point(begin, r, self.slopes(begin, r)), tolerance, renew=renew)


def exponentials(x):
    """Two decays with the logarithms of their sizes and rates, compared with others, with noise."""
    size, rate, more, fast = np.exp(x)
    return size * np.exp(-rate * T) + more * np.exp(-fast * T) - np.exp(-T) - 0.5 * np.exp(-6.0 * T) - NOISE


def bent(x):
    """Rosenbrock's valley: the residuals of its function."""
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


BEGIN = np.log([2.0, 0.5, 1.0, 10.0])


def test_the_minimum_is_that_of_scipy():
    known = least_squares(exponentials, BEGIN, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = Counted(exponentials, 4).search(BEGIN)
    assert found.x == pytest.approx(known.x, abs=2e-4)
    assert found.squares == pytest.approx(2.0 * known.cost, rel=1e-9)
    assert found.squares >= 2.0 * known.cost * (1.0 - 1e-12)


def test_it_needs_fewer_runs_than_derivatives_by_differences_at_every_step():
    mine, usual = Counted(exponentials, 4), Counted(exponentials, 4)
    found = mine.search(BEGIN, 1e-4, renew=False)
    known = least_squares(usual, BEGIN, jac=lambda x: usual.slopes(x, exponentials(x)), ftol=1e-4)
    assert found.squares == pytest.approx(2.0 * known.cost, rel=1e-3)
    assert mine.runs < 0.7 * usual.runs


def test_a_bent_valley_is_followed_to_its_end():
    law = Counted(bent, 2)
    found = law.search([-1.2, 1.0], tolerance=1e-12)
    assert found.x == pytest.approx([1.0, 1.0], abs=1e-6)
    assert law.runs <= 40


@pytest.mark.parametrize("high", [0.4, 3.0])
def test_a_minimum_at_a_bound_is_that_of_scipy(high):
    begin = np.array([0.1, -0.1, -1.0, 0.3])
    known = least_squares(exponentials, begin, bounds=(-3.0, high), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = Counted(exponentials, 4).search(begin, low=-3.0, high=high)
    assert found.squares == pytest.approx(2.0 * known.cost, rel=1e-6)
    assert (found.x <= high).all() and (found.x >= -3.0).all()
    assert (found.x.max() == pytest.approx(high)) == (high < 1.0)


def test_an_update_agrees_with_its_run_and_leaves_other_directions():
    descent = Descent(exponentials, None, np.full(4, -9.0), np.full(4, 9.0), np.ones(4))
    x, step = np.array([0.1, -0.1, -1.0, 0.3]), np.array([0.1, 0.0, 0.2, 0.0])
    at = Point(x, exponentials(x), np.random.default_rng(1).standard_normal((len(T), 4)))
    new = descent._moved(at, step)
    assert new.slopes @ step == pytest.approx(exponentials(x + step) - exponentials(x))
    across = np.array([0.2, 1.0, -0.1, 0.0])
    assert new.slopes @ across == pytest.approx(at.slopes @ across) and not new.fresh


def test_a_search_ends_where_it_arrives_and_after_its_runs():
    begin, edges = np.array([-1.2, 1.0]), np.full(2, 10.0)
    law = Counted(bent, 2)
    descent = Descent(law, law.slopes, -edges, edges, np.ones(2))
    first = Point(begin, bent(begin), law.slopes(begin, bent(begin)))
    assert descent.run(first, 1e-12, lambda at: at.squares < 10.0).squares < 10.0
    law.runs = 0
    descent.run(first, 1e-12, most=5)
    assert 5 <= law.runs <= 8  # the last step may compute derivatives again
