"""Intervals hold what they state, neither less nor more, with noise of each kind: simulated here."""

import math

import numpy as np
import pytest

from palpate.models.fit.tissue.errors.hum import include_hum
from palpate.models.fit.tissue.estimate import Problem, estimate
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.measured import prepare_press
from palpate.models.fit.tissue.residuals import CORRELATIONS, correlation_likelihoods
from palpate.models.fit.tissue.rigs import Rig, closed_form

YOUNG, BALL, CYLINDER = 1e4, Rig("ball", 30e-3), Rig("cylinder", 10e-3, 10e-3)


def press_of(rig, rows, share, rng, noise, step=0.0):
    """A press of this many rows, of which a share is in contact; noise (n,) and step over the peak."""
    time = np.linspace(0.0, 1.0, rows)
    depth = 2e-3 * (time - 1.0 + share) / share
    s = np.maximum(depth, 0.0)
    force = 16.0 / 9.0 * YOUNG * math.sqrt(rig.radius) * s**1.5  # Hertz, incompressible
    if rig.kind == "cylinder":
        force = math.pi * rig.radius**2 * YOUNG * s / rig.height
    peak = force.max()
    force = force + peak * noise
    if step:
        force = step * peak * np.round(force / (step * peak) + rng.uniform())
    return prepare_press("press.csv", time, depth + 1e-4, force)


def share_inside(rig, law, draws, press):
    """Share of the draws whose interval contains the true modulus, with the zero that the fit estimates."""
    inside = 0
    for seed in range(draws):
        problem = Problem(
            [press(np.random.default_rng(seed))], closed_form(rig, law), "none", True, rig.kind == "cylinder"
        )
        best = estimate(problem, profiles=False, begin=[problem.start()])
        found = include_hum(problem, best)[1].intervals["young"]
        inside += found.low <= YOUNG <= found.high
    return inside / draws


def coloured(rng, rows, rho):
    white = rng.standard_normal(rows)
    for k in range(1, rows):
        white[k] = rho * white[k - 1] + math.sqrt(1.0 - rho**2) * white[k]
    return white


@pytest.mark.parametrize(("rho", "share"), [(0.0, 0.5), (0.9, 0.5), (0.9, 0.1)])
def test_correlated_noise_counts_by_what_it_changes(rho, share):
    """300 draws: 92 to 98 % +- 1.5 %. A correlation of 0.9 over 20 rows in contact counted as over all 200: 100 %."""
    found = share_inside(
        BALL, "hertz", 300, lambda rng: press_of(BALL, 200, share, rng, 0.01 * coloured(rng, 200, rho))
    )
    assert 0.905 <= found <= 0.99


def test_rows_with_larger_weights_do_not_have_larger_noise():
    """Weights of 1 over the force, because forces of a cylinder span decades, and noise of one size: 100 % before."""
    found = share_inside(
        CYLINDER, "linear", 300, lambda rng: press_of(CYLINDER, 200, 0.4, rng, 0.01 * rng.standard_normal(200))
    )
    assert 0.905 <= found <= 0.99


@pytest.mark.parametrize(("step", "noise"), [(0.01, 0.01), (0.02, 0.006), (0.02, 0.003)])
def test_steps_of_a_converter_count_once(step, noise):
    """They are a part of the residuals. Their variance was added to that of all residuals, and noise of less than 0.4
    steps did not count as decorrelating them."""
    found = share_inside(
        BALL, "hertz", 300, lambda rng: press_of(BALL, 200, 0.4, rng, noise * rng.standard_normal(200), step)
    )
    assert 0.905 <= found <= 0.99


def humming(rng, rows, size, white):
    """Noise (n,) of a line with a period of 3 to 30 rows, and white noise."""
    turn = 2.0 * math.pi * (np.arange(rows) / rng.uniform(3.0, 30.0) + rng.uniform())
    return size * math.sqrt(2.0) * np.sin(turn) + white * rng.standard_normal(rows)


def test_a_hum_is_fitted_with_the_parameters():
    """It counted as white noise of its size: 99 to 100 %, of intervals that were nine times as wide."""
    found = share_inside(BALL, "hertz", 300, lambda rng: press_of(BALL, 200, 0.4, rng, humming(rng, 200, 0.01, 0.001)))
    assert 0.905 <= found <= 0.99
    fit = fit_tissue(
        [press_of(BALL, 200, 0.4, None, humming(np.random.default_rng(0), 200, 0.01, 0.001))], BALL, "hertz"
    )
    found_young = fit.estimate.intervals["young"]
    value, low, high = found_young.value, found_young.low, found_young.high
    assert high - low < 0.05 * value and low <= YOUNG <= high
    assert any("a hum was fitted" in note for note in fit.notes)


def test_a_hum_alone_does_not_change_the_value():
    rng, time = np.random.default_rng(1), np.linspace(0.0, 1.0, 200)
    noise = 0.02 * np.sin(2.0 * math.pi * (25.3 * time + rng.uniform()))
    fit = fit_tissue([press_of(BALL, 200, 0.4, rng, noise)], BALL, "hertz")
    assert fit.estimate.intervals["young"].value == pytest.approx(YOUNG, rel=1e-4)
    (note,) = [note for note in fit.notes if "hum" in note]
    assert "25.3 cycles (25.3 Hz)" in note


@pytest.mark.parametrize("rho", [0.0, 0.9, 0.97])
def test_random_noise_is_no_hum(rho):
    for seed in range(60):
        rng = np.random.default_rng(seed)
        problem = Problem(
            [press_of(BALL, 60, 0.4, rng, 0.01 * coloured(rng, 60, rho))],
            closed_form(BALL, "hertz"),
            "none",
            True,
            False,
        )
        assert include_hum(problem, estimate(problem, profiles=False))[2] == []


def test_the_likelihood_of_a_correlation_is_that_of_the_density_of_all_residuals():
    """Against the restricted normal density of r = y - J b, written with the matrix of covariances."""
    rng = np.random.default_rng(0)
    J, n = rng.standard_normal((40, 3)), 40
    y = coloured(rng, n, 0.7)
    r = y - J @ np.linalg.lstsq(J, y, rcond=None)[0]
    logs, variances = correlation_likelihoods(r, J, np.array([0]))
    expected = []
    for rho, variance in zip(CORRELATIONS, variances, strict=True):
        R = rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        inverse = np.linalg.inv(R)
        gram = J.T @ inverse @ J
        left = r @ inverse @ r - r @ inverse @ J @ np.linalg.solve(gram, J.T @ inverse @ r)
        assert variance == pytest.approx(left / (n - 3), rel=1e-6)
        log = -0.5 * (np.linalg.slogdet(R)[1] + np.linalg.slogdet(gram)[1] + (n - 3) * math.log(left))
        expected.append(log + math.log(1.0 - rho**2))
    assert np.allclose(logs - logs[0], np.array(expected) - expected[0], atol=1e-6)
