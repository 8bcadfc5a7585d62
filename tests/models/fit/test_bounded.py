"""The search within bounds finds the minima of scipy, or lower ones."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.models.fit.tissue.bounded import minimize_squares


def curve(seed):
    """Residuals of a sum of two exponentials of similar rates with noise, their derivatives, a start, and bounds of
    which some are active at the minimum."""
    rng = np.random.default_rng(seed)
    t, true = np.linspace(0.0, 3.0, 80), np.array([1.0, rng.uniform(0.3, 1.0), 0.7, rng.uniform(1.0, 5.0)])
    y = true[0] * np.exp(-true[1] * t) + true[2] * np.exp(-true[3] * t) + 0.02 * rng.standard_normal(80)

    def residuals(z):
        return z[0] * np.exp(-z[1] * t) + z[2] * np.exp(-z[3] * t) - y

    def jacobian(z):
        one, two = np.exp(-z[1] * t), np.exp(-z[3] * t)
        return np.stack([one, -z[0] * t * one, two, -z[2] * t * two], axis=1)

    low = true - rng.uniform(-0.1, 0.5, 4)
    return residuals, jacobian, rng.uniform(low, low + 0.6), low, low + 0.6


def test_it_finds_the_minimum_of_scipy_within_bounds():
    """Of 200 problems, each with 4 unknowns; in about half of them a bound is active."""
    active = 0
    for seed in range(200):
        residuals, jacobian, begin, low, high = curve(seed)
        found = minimize_squares(residuals, jacobian, begin, low, high)
        expected = least_squares(residuals, begin, jacobian, bounds=(low, high), xtol=1e-12, ftol=1e-12, gtol=1e-12)
        assert (low <= found).all() and (found <= high).all()
        assert float(np.sum(residuals(found) ** 2)) <= 2.0 * expected.cost * (1.0 + 1e-6), seed
        active += bool(((found == low) | (found == high)).any())
    assert active > 50


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_residuals_that_are_no_numbers_end_the_search_at_the_last_good_point(value):
    def residuals(z):
        return np.array([z[0] - 3.0, 0.1 * z[0]]) if z[0] < 2.0 else np.full(2, value)

    found = minimize_squares(
        residuals, lambda z: np.array([[1.0], [0.1]]), np.zeros(1), np.full(1, -9.0), np.full(1, 9.0)
    )
    assert 0.0 <= found[0] < 2.0


@pytest.mark.parametrize("size", [np.nan, np.inf, 1e200])
def test_slopes_beyond_the_range_of_numbers_end_the_search(size):
    """They gave unknowns that are no numbers: a crash of `cylinder demiray` in the search for fits."""
    with np.errstate(all="ignore"):
        found = minimize_squares(
            lambda z: z - 1.0, lambda z: np.full((2, 2), size), np.zeros(2), np.full(2, -9.0), np.full(2, 9.0)
        )
    assert np.isfinite(found).all()


def test_an_unknown_without_effect_stays():
    found = minimize_squares(
        lambda z: z[:1] - 1.0, lambda z: np.array([[1.0, 0.0]]), np.array([0.0, 0.3]), np.full(2, -2.0), np.full(2, 2.0)
    )
    assert found == pytest.approx([1.0, 0.3])
    none = np.zeros(0)
    assert len(minimize_squares(lambda z: np.ones(3), lambda z: np.zeros((3, 0)), none, none, none)) == 0
