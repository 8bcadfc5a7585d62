"""Psychometric functions, their fit, and QUEST+, each compared with an independent result."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, optimize, stats
from simulated_sessions import DESIGNS, QUICK, Sessions

from palpate.studies.psychophysics.fit import fit
from palpate.studies.psychophysics.functions import AT, FUNCTIONS, HALF, proportion
from palpate.studies.psychophysics.questplus import QuestPlus


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_rises_from_the_guess_rate_to_one_less_the_lapse_rate(name):
    x = np.array([-np.inf, 1e-9, 1.0, 2.0, 3.0, 1e9])
    share = proportion(name, x, 2.0, 0.5 if name != "weibull" else 3.0, 0.25, 0.05)
    assert share[0] == 0.25 and share[-1] == pytest.approx(0.95) and (np.diff(share) >= 0.0).all()
    assert share[3] == pytest.approx(0.25 + 0.7 * AT[name])


@pytest.mark.parametrize("name", HALF)
def test_the_difference_threshold_is_half_the_interquartile_range(name):
    quartiles = [optimize.brentq(lambda x, q=q: FUNCTIONS[name](x, 3.0, 0.7) - q, -20.0, 20.0) for q in (0.25, 0.75)]
    assert (quartiles[1] - quartiles[0]) / 2.0 == pytest.approx(0.7 * HALF[name])


def test_the_normal_function_is_the_integral_of_a_density():
    area, _ = integrate.quad(stats.norm(2.0, 0.4).pdf, -np.inf, 2.3)
    assert FUNCTIONS["normal"](2.3, 2.0, 0.4) == pytest.approx(area)


def shares(name, guess, lapse, seed=3):
    """Levels and answers of an observer with a threshold of 2."""
    x = np.repeat(np.linspace(0.5, 4.0, 8), 40)
    chance = proportion(name, x, 2.0, 3.0 if name == "weibull" else 0.6, guess, lapse)
    return x, np.random.default_rng(seed).random(len(x)) < chance


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_marginal_posterior_is_that_of_random_draws_from_the_prior(name):
    """Importance sampling: draws of a, b and λ, weighted by the likelihood of the answers."""
    x, hits = shares(name, 0.5, 0.02)
    found = fit(name, x, hits, 0.5)
    random, count = np.random.default_rng(1), 400_000
    ratio = name == "weibull"
    a, b = (0.5, 4.0, 1.75), np.log([0.25, 3.5, 3.0])
    if ratio:
        a, b = np.log([0.5, 4.0, np.sqrt(8.0)]), np.log([0.7, 6.0, 2.0])
    draw = {"a": a, "b": b}
    weight = np.ones(count)
    for key, (low, high, room) in draw.items():
        draw[key] = random.uniform(low - room, high + room, count)
        outside = np.maximum(np.maximum(low - draw[key], draw[key] - high), 0.0) / room
        weight *= 0.5 + 0.5 * np.cos(np.pi * outside)
    a, b = np.exp(draw["a"]) if ratio else draw["a"], np.exp(draw["b"])
    lapse = random.beta(1.0, 10.0, count)
    levels, at = np.unique(x, return_inverse=True)
    chance = proportion(name, levels[:, None], a, b, 0.5, lapse)
    k, n = np.bincount(at, hits)[:, None], np.bincount(at)[:, None]
    weight *= stats.binom.pmf(k, n, chance).prod(axis=0)
    for number, values in ((found.threshold, a), (found.spread, b)):
        order = np.argsort(values)
        share = np.cumsum(weight[order]) / weight.sum()
        ends = values[order][np.searchsorted(share, [0.025, 0.5, 0.975])]
        assert (number.low, number.value, number.high) == pytest.approx(tuple(ends), rel=0.03)
    assert found.lapse == pytest.approx(np.average(lapse, weights=weight), abs=2e-3)
    middle, low, high = found.curve([2.0])[:, 0]
    one = proportion(name, 2.0, a, b, 0.5, lapse)
    order = np.argsort(one)
    ends = one[order][np.searchsorted(np.cumsum(weight[order]) / weight.sum(), [0.025, 0.975])]
    assert (middle, low, high) == pytest.approx((np.average(one, weights=weight), *ends), abs=0.01)


def test_levels_that_do_not_bound_the_threshold_leave_its_interval_open():
    x = np.repeat([1.0, 2.0, 3.0], 20)
    found = fit("normal", x, np.random.default_rng(0).random(60) < 0.5, 0.5)
    assert math.isinf(found.threshold.high)
    assert "the answers do not bound the threshold above" in found.limits
    with pytest.raises(ValueError, match="no level"):
        fit("normal", [-np.inf], [True], None)


def test_false_alarms_give_the_guess_rate():
    x, hits = shares("normal", 0.2, 0.0)
    catch = np.arange(200) % 5 == 0
    found = fit("normal", np.concatenate([x, np.full(200, -np.inf)]), np.concatenate([hits, catch]), None)
    assert found.guess == pytest.approx(0.2, abs=0.05)


def test_a_step_that_fits_best_does_not_decide_the_threshold():
    """Answers of the shipped staircase. Their likelihood is largest for a step at 10.5 with 10 % lapses."""
    distance = [6.8, 8.8, 11.4, 14.9, 16.9, 19.3, 22.0, 28.6, 32.6, 37.1, 42.4, 62.7, 81.6, 93.2, 128.0, 204.8, 257.0]
    right = [0, 3, 8, 1, 1, 2, 8, 3, 2, 4, 2, 3, 3, 2, 0, 2, 5]
    wrong = [1, 4, 1, 0, 3, 0, 0, 1, 0, 0, 0, 1, 1, 0, 1, 0, 0]
    x = np.repeat(distance + distance, right + wrong)
    found = fit("weibull", x, np.arange(len(x)) < sum(right), 0.5)
    assert 13.0 < found.threshold.value < 25.0 and found.threshold.high > 32.0
    assert "the answers do not bound the spread above" in found.limits


def test_frequent_lapses_are_reported():
    x, hits = shares("normal", 0.5, 0.2)
    assert "more than 10 % of the answers do not depend on the level" in fit("normal", x, hits, 0.5).limits


@pytest.mark.parametrize("design", QUICK)
def test_intervals_contain_the_threshold_of_the_observer(design, write):
    """Of 40 sessions; at a coverage of 95 %, fewer than 34 have a probability of 1 in 300."""
    one = Sessions(design, write)
    assert one.covered(one.estimates(range(1, 41))) >= 34


@pytest.mark.long
@pytest.mark.parametrize("design", DESIGNS)
def test_intervals_contain_the_threshold_of_the_observer_in_about_95_of_100_sessions(design, write):
    """Of 200 sessions; at a coverage of 95 %, fewer than 183 have a probability of 1 in 200."""
    one = Sessions(design, write)
    assert one.covered(one.estimates(range(1, 201))) >= 183


GRIDS = {
    "levels": np.linspace(0.5, 4.0, 15), "thresholds": np.linspace(0.5, 4.0, 12), "spreads": np.array([1.0, 2.0, 4.0]),
    "lapses": np.array([0.0, 0.04]),
}  # fmt: skip


def test_quest_plus_asks_at_the_level_of_the_least_expected_entropy():
    """The expected value is computed from the definition, branch by branch, not from the mutual information."""
    quest = QuestPlus("weibull", *GRIDS.values(), 0.5)
    random = np.random.default_rng(1)
    for _ in range(5):
        a, b, lapse = quest.grid
        expected = []
        for x in quest.levels:
            hit = proportion("weibull", x, a, b, 0.5, lapse)
            entropy = 0.0
            for chance in (hit, 1.0 - hit):
                posterior = chance * quest.posterior
                entropy += posterior.sum() * stats.entropy(posterior)
            expected.append(entropy)
        level = quest.levels[np.argmax(quest.information())]
        assert level == quest.levels[np.argmin(expected)]
        quest.update(level, bool(random.random() < 0.8))


def test_quest_plus_agrees_with_the_package_questplus():
    package = pytest.importorskip("questplus")
    own = QuestPlus("weibull", *GRIDS.values(), 0.5)
    names = ("threshold", "slope", "lapse_rate")
    other = package.QuestPlus(
        stim_domain={"intensity": GRIDS["levels"]},
        param_domain={**dict(zip(names, list(GRIDS.values())[1:], strict=True)), "lower_asymptote": [0.5]},
        outcome_domain={"response": ["yes", "no"]},
        func="weibull",
        stim_scale="linear",
    )
    random = np.random.default_rng(2)
    for _ in range(25):
        level = float(own.levels[np.argmax(own.information())])
        assert other.next_stim["intensity"] == pytest.approx(level)
        hit = bool(random.random() < proportion("weibull", level, 1.7, 2.0, 0.5, 0.02))
        own.update(level, hit)
        other.update(stim={"intensity": level}, outcome={"response": "yes" if hit else "no"})
    assert other.posterior.to_numpy().ravel() == pytest.approx(own.posterior, abs=1e-12)
    assert own.grid @ own.posterior == pytest.approx([other.param_estimate[name] for name in names])


def test_lengths_are_drawn_in_millimetres():
    figures = pytest.importorskip("matplotlib.figure")
    from palpate.studies.psychophysics.pictures import _magnitude

    axes = figures.Figure().add_subplot()
    levels = [1e-3, 2e-3, 4e-3]
    given = {"levels": levels, "shares": [1.0, 2.0, 4.0], "counts": [4, 4, 4], "unit": "m", "path": "scene.depth"}
    _magnitude(axes, SimpleNamespace(numbers={"exponent": SimpleNamespace(value=1.0)}, **given))
    assert axes.get_xlabel() == "scene.depth [mm]"
    points, line = (drawn.get_xydata() for drawn in axes.lines)
    assert points == pytest.approx(np.array([[1, 1], [2, 2], [4, 4]])) and line == pytest.approx(points)


def test_an_answer_that_every_parameter_excludes_leaves_a_posterior():
    """Without lapses and guesses these probabilities are 0 to rounding; the next answers still count."""
    quest = QuestPlus("weibull", [0.0, 1.0, 100.0], [1.0, 2.0, 4.0], [3.0], [0.0], 0.0)
    for level, hit in ((0.0, True), (100.0, False), *[(1.0, True)] * 60, *[(1.0, False)] * 3):
        quest.update(level, hit)
        assert np.isfinite(quest.posterior).all() and quest.posterior.sum() == pytest.approx(1.0)
        assert np.isfinite(quest.information()).all()
    assert int(np.argmax(quest.posterior)) == 0


def test_answers_that_bound_no_slope_are_named():
    x = np.repeat([1.0, 2.0, 3.0], 10)
    step, flat = fit("normal", x, x > 1.5, 0.0), fit("normal", x, np.arange(30) % 2 == 0, 0.0)
    assert "the answers do not bound the spread below" in step.limits
    assert "the answers do not bound the spread above" in flat.limits
    many = np.repeat(np.linspace(0.5, 4.0, 8), 400)
    hits = np.random.default_rng(3).random(len(many)) < proportion("normal", many, 2.0, 0.6, 0.5, 0.02)
    assert fit("normal", many, hits, 0.5).limits == ()
