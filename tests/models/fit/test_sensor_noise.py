"""Steps of a converter, noise that grows with the force, and drift below the noise: intervals allow for them."""

import math

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.estimate import Problem, estimate
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.measured import prepare_press
from palpate.models.fit.tissue.noise import dither, gain, quantised_variance, step_of
from palpate.models.fit.tissue.report import data
from palpate.models.fit.tissue.rigs import Rig, closed_form

PUNCH, BALL = Rig("punch", 20e-3), Rig("ball", 30e-3)
TIME = np.linspace(-1.0, 2.0, 300)
DEPTH = np.clip(TIME / 2.0, -0.5, 1.0) * 2e-3
YOUNG = 1e4


def ideal(rig):
    return closed_form(rig, "hertz").force({"young": YOUNG}, np.maximum(DEPTH, 0.0))


def correlated(rho, rng):
    white = rng.standard_normal(len(TIME))
    for k in range(1, len(white)):
        white[k] = rho * white[k - 1] + math.sqrt(1.0 - rho**2) * white[k]
    return white


def spoilt(rig, what, seed):
    force, rng = ideal(rig), np.random.default_rng(seed)
    peak = force.max()
    if what == "step":
        force = 0.02 * peak * np.round(force / (0.02 * peak) + rng.uniform())
    elif what == "drift":
        force = force + peak * (0.005 * rng.standard_normal(len(TIME)) + 0.004 * (TIME + 1.0) / 3.0)
    elif what == "gain":
        force = force * (1.0 + 0.02 * correlated(0.9, rng)) + 0.001 * peak * rng.standard_normal(len(TIME))
    return prepare_press("press.csv", TIME, DEPTH + 1e-4, force)


@pytest.mark.parametrize("what", ["white", "step", "drift", "gain"])
@pytest.mark.parametrize("rig", [PUNCH, BALL])
def test_intervals_contain_the_true_value_with_each_noise(rig, what):
    """95 % contain it, so that 16 of 20 do in 997 of 1000 draws. More: benchmarks/fit_coverage.py."""
    held, law = 0, closed_form(rig, "hertz")
    for seed in range(20):
        problem = Problem([spoilt(rig, what, seed)], law, "none", True, False)
        found = estimate(problem, profiles=False, begin=[problem.start()]).intervals["young"]
        held += found.low <= YOUNG <= found.high
        assert found.high / found.low < 1.5
    assert held >= 16


def test_the_step_is_found_from_repeated_values_and_only_there():
    rng = np.random.default_rng(0)
    force = np.linspace(0.0, 1.0, 500)
    assert step_of(0.02 * np.round(force / 0.02) - 0.003) == approx(0.02)
    assert step_of(0.013 * np.round((force + 0.005 * rng.standard_normal(500)) / 0.013)) == approx(0.013)
    assert step_of(force + 1e-3 * rng.standard_normal(500)) == 0.0
    assert step_of(np.minimum(force, 0.3)) == 0.0  # saturated, not quantised


@pytest.mark.parametrize("noise", [0.0, 0.2, 1.0])
def test_the_variance_of_a_sum_of_rounding_errors_is_that_of_drawn_ones(noise):
    """Monte Carlo with random zeros: an independent route to the Fourier series."""
    rng, step = np.random.default_rng(1), 0.05
    force = np.concatenate([np.zeros(60), np.linspace(0.0, 1.0, 90) ** 1.5])
    rows = np.stack([np.ones(150) / 150, force, np.where(force > 0.0, 0.0, 1.0 / 60)])
    draws = []
    for _ in range(1500):
        given = force + step * rng.uniform() + noise * step * rng.standard_normal(150)
        draws.append(rows @ (step * np.round(given / step) - given))
    found, drawn = quantised_variance(rows, force, step, noise * step), np.var(draws, axis=0)
    assert np.all(found > 0.8 * drawn)
    assert np.all(found < 2.0 * drawn)
    if noise == 0.0:  # all rows before contact have the same error
        assert found[2] == approx(step**2 / 12.0, rel=0.1)


@pytest.mark.parametrize("still", [0, 400])
def test_the_noise_before_the_converter_is_found_from_second_differences(still):
    """Noise below 0.4 steps counted as none, at worst. The mean over draws, since the place in a step matters."""
    rng, step = np.random.default_rng(2), 0.02
    force = np.concatenate([np.zeros(still), np.linspace(0.0, 1.0, 400)])
    for noise, tolerance in ((0.1, 0.3), (0.2, 0.15), (0.5, 0.05), (2.0, 0.05)):
        found = []
        for _ in range(60):
            given = force + step * (rng.uniform() + noise * rng.standard_normal(len(force)))
            found.append(dither(step * np.round(given / step), force, step) / step)
        assert np.mean(found) == approx(noise, rel=tolerance)
    assert dither(step * np.round(force / step + 0.2), force, step) <= 0.1 * step


def test_rows_that_are_means_of_several_show_the_noise_of_single_ones():
    rng, step = np.random.default_rng(3), 0.02
    force = np.repeat(np.linspace(0.0, 1.0, 400), 4)
    found = []
    for _ in range(40):
        given = step * np.round(force / step + rng.uniform() + 0.5 * rng.standard_normal(1600))
        found.append(dither(given.reshape(400, 4).mean(axis=1), force[::4], step, 4) / step)
    assert np.mean(found) == approx(0.5, rel=0.05)
    rows = np.ones((1, 400)) / 400
    alone, means = (quantised_variance(rows, force[::4], step, 2.0 * step, many) for many in (1, 4))
    assert means == approx(alone / 4.0, rel=1e-3)


def test_noise_that_grows_with_the_force_is_distinguished_from_uniform_noise():
    rng = np.random.default_rng(3)
    force = ideal(BALL)
    assert gain(force, 0.01 * force.max() * rng.standard_normal(300), 3) is None
    found = gain(force, force * 0.02 * correlated(0.9, rng) + 1e-4 * force.max() * rng.standard_normal(300), 3)
    assert found is not None and found[1] > 4.0
    assert found[0][-1, -1] > 100.0 * found[0][0, 0]


def drifting(rig, seed, power=2, air=True, rows=300, size=0.02):
    """A press whose zero drifts by 2 % of the peak, along a line or a curve, with white noise."""
    force, rng = ideal(rig), np.random.default_rng(seed)
    force = force + force.max() * rng.choice((-1.0, 1.0)) * size * ((TIME + 1.0) / 3.0) ** power
    force = force + 0.005 * force.max() * rng.standard_normal(len(TIME))
    kept = np.arange(0 if air else 100, 300, 300 // rows)
    return prepare_press("press.csv", TIME[kept], DEPTH[kept] + 1e-4, force[kept])


@pytest.mark.parametrize("rig", [PUNCH, BALL])
def test_the_interval_contains_the_true_value_if_the_zero_drifts_along_a_curve(rig):
    """With a linear drift alone 22 of 24 intervals miss it, without a note. More: benchmarks/fit_coverage.py."""
    held, narrow, listed = 0, 0, 0
    for seed in range(6):
        fit = fit_tissue([drifting(rig, seed)], rig, "hertz")
        found, (low, high) = fit.estimate.intervals["young"], fit.steady["young"]
        held += found.low <= YOUNG <= found.high
        narrow += low <= YOUNG <= high
        assert found.high / found.low < 1.5
        listed += any("--drift linear" in text for text in fit.open_)
    assert held >= 5
    assert listed >= 5  # not where the misfit of the law has widened it already
    assert narrow <= 3


@pytest.mark.parametrize("power", [1, 2])
def test_the_interval_of_a_press_without_rows_before_contact_allows_for_drift(power):
    for seed in range(4):
        fit = fit_tissue([drifting(BALL, seed, power, air=False)], BALL, "hertz")
        found = fit.estimate.intervals["young"]
        assert found.low <= YOUNG <= found.high


def test_no_interval_is_given_if_the_force_may_be_a_drift():
    """A force that rises linearly in time without rows before contact cannot be distinguished from a drift."""
    time = np.linspace(0.0, 2.0, 200)
    depth = (time / closed_form(BALL, "hertz").force({"young": YOUNG}, np.ones(1))[0]) ** (2.0 / 3.0) / 2.0
    force = closed_form(BALL, "hertz").force({"young": YOUNG}, depth)
    force = force + 0.001 * force.max() * np.random.default_rng(0).standard_normal(200)
    press = prepare_press("press.csv", time, depth, force)
    fit = fit_tissue([press], BALL, "hertz")
    assert fit.estimate.withheld
    assert any("do not distinguish the force from a zero that drifts" in note for note in fit.notes)
    assert not any("--drift" in text for text in fit.open_)
    found = fit_tissue([press], BALL, "hertz", drift="none").estimate.intervals["young"]
    assert found.low <= YOUNG <= found.high and found.high < 1.1 * found.low


def test_an_assumption_about_the_drift_narrows_the_interval():
    press = drifting(PUNCH, 0, size=0.0)
    widths = []
    for drift in ("none", "linear", "curved"):
        found = fit_tissue([press], PUNCH, "hertz", drift=drift).estimate.intervals["young"]
        widths.append(found.high - found.low)
    assert widths[0] < widths[1] / 2.0 < widths[2] / 3.0
    # a zero that drifts although the user excludes it counts as a misfit of the law
    found = fit_tissue([drifting(PUNCH, 0, power=1)], PUNCH, "hertz", drift="none").estimate.intervals["young"]
    assert found.low <= YOUNG <= found.high
    with pytest.raises(SessionError, match="--drift: found 'no', expected curved, linear, none"):
        fit_tissue([press], PUNCH, "hertz", drift="no")


def test_a_press_with_too_few_rows_to_fit_a_drift_is_reported():
    """Ten rows suffice for modulus, touch point and zero; 14 rows also for a zero that drifts along a line."""
    press = drifting(BALL, 0, air=False, rows=15)
    assert len(press.depth) == 10
    fit = fit_tissue([press], BALL, "hertz")
    (note,) = [note for note in fit.notes if "too few to fit a zero of the force that drifts" in note]
    assert fit.estimate.withheld and "--drift none gives young" in note
    assert not fit_tissue([press], BALL, "hertz", drift="none").estimate.withheld
    fit = fit_tissue([drifting(BALL, 0, air=False, rows=20)], BALL, "hertz")
    assert not any("too few" in note for note in fit.notes)


def test_an_offset_of_a_press_without_rows_before_contact_is_no_saturation():
    """A load cell that was not tared: the offset is many times the force of the press."""
    rows = slice(110, None)
    for offset in (-5.0, 5.0):
        force = ideal(BALL)[rows] + offset * ideal(BALL).max()
        force = force + 0.002 * np.random.default_rng(1).standard_normal(len(force)) * ideal(BALL).max()
        fit = fit_tissue([prepare_press("press.csv", TIME[rows], DEPTH[rows], force)], BALL, "hertz", drift="none")
        found = fit.estimate.intervals["young"]
        assert found.low <= YOUNG <= found.high and not fit.estimate.withheld
        assert not any("saturated" in note or "excluded" in note for note in fit.notes)


def test_a_rise_before_contact_is_fitted_and_withholds_nothing():
    peak = ideal(BALL).max()
    for seed in range(3):
        rise = 0.05 * peak * np.exp(np.minimum(DEPTH, 0.0) / (0.25 * -DEPTH.min()))
        force = ideal(BALL) + rise + 0.003 * peak * np.random.default_rng(seed).standard_normal(len(TIME))
        fit = fit_tissue([prepare_press("press.csv", TIME, DEPTH, force)], BALL, "hertz")
        found = fit.estimate.intervals["young"]
        assert found.low <= YOUNG <= found.high and not fit.estimate.withheld
        assert any("the force rises before contact" in note for note in fit.notes)


@pytest.mark.parametrize(("seed", "hardening"), [(1, 16e3), (3, 13e3), (5, 16e3)])
def test_a_press_in_contact_from_the_first_row_is_not_taken_for_a_rise_before_contact(seed, hardening):
    """An exponential law without a zero has the shape of an exponential rise and the law from a later touch point."""
    depth, rng = np.linspace(-2.1e-4, 5.5e-5, 400), np.random.default_rng(seed)
    force = 0.4 / hardening * np.expm1(hardening * (depth - depth[0]))
    force = force + force.max() * (0.003 * rng.standard_t(3, 400) - 0.4)
    press = prepare_press("press.csv", 8e-3 * np.arange(400), depth, force)
    fit = fit_tissue([press], Rig("ball", 6.3e-3), "exponential")
    found = fit.estimate.intervals["stiffness"]
    assert any("rises before contact" in note for note in fit.notes)
    assert fit.estimate.withheld or found.low <= 0.4 <= found.high


def test_a_hold_at_constant_force_is_excluded_from_the_loading():
    """A force-controlled instrument ramps and holds the force, and the tissue creeps by 10 %."""
    time = np.linspace(-1.0, 8.0, 450)
    force = 0.2 * np.clip(time, 0.0, 2.0)
    depth = (force / closed_form(BALL, "hertz").force({"young": YOUNG}, np.ones(1))[0]) ** (2.0 / 3.0)
    depth = depth * (1.0 + 0.1 * (1.0 - np.exp(-np.maximum(time - 2.0, 0.0)))) + 1e-3 * np.minimum(time, 0.0)
    force = force + 0.001 * np.random.default_rng(0).standard_normal(len(time))
    fit = fit_tissue([prepare_press("press.csv", time, depth, force)], BALL, "hertz")
    found = fit.estimate.intervals["young"]
    assert found.low <= YOUNG <= found.high and found.value == pytest.approx(YOUNG, rel=0.03)
    assert not fit.estimate.withheld
    assert any("the force is held while the indenter creeps" in note for note in fit.notes)
    assert fit.presses[0].time[-1] == approx(2.0, abs=0.1)
    # a press at constant speed has no hold, for any noise
    for seed in range(5):
        press = drifting(BALL, seed, size=0.0)
        assert len(fit_tissue([press], BALL, "hertz").presses[0].depth) == len(press.depth)


@pytest.mark.parametrize("seed", [7002, 7008])
def test_an_interval_is_not_cut_off_where_the_fit_without_a_bend_is_as_likely(seed):
    """White noise, from contact on: a bend and an exponent of 1.1 fit by chance as well as the true exponent of 1.5."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 2.0, 300)
    force = 3e3 * (1e-3 * time) ** 1.5
    press = prepare_press("press.csv", time, 1e-3 * time + 1e-4, force + 0.01 * force.max() * rng.standard_normal(300))
    fit = fit_tissue([press], BALL, "power")
    assert not fit.estimate.withheld
    for name, truth in (("stiffness", 3e3), ("exponent", 1.5)):
        assert fit.estimate.intervals[name].low <= truth <= fit.estimate.intervals[name].high


def test_the_report_names_the_drift_that_the_intervals_allow_for():
    press = spoilt(BALL, "white", 0)
    curved, linear = (data(fit_tissue([press], BALL, "hertz", drift=drift)) for drift in ("curved", "linear"))
    assert curved["drift"] == "curved" and curved["without_curved_drift"]["young"]["low"] < YOUNG
    assert linear["drift"] == "linear" and linear["without_drift"] == {} and "without_curved_drift" not in linear
