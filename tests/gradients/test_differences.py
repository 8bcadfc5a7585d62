"""Derivatives from differences at three steps (gradients/differences.py), on functions with known derivatives."""

import numpy as np
import pytest

from palpate.gradients.differences import STEPS, central, one_sided

TIMES = np.linspace(0.1, 2.0, 400)


def three(function, x, h):
    return np.stack([function(x + h * step) for step in STEPS])


def both(function, x, h, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    values = function(x), three(function, x, h), three(function, x, -h)
    return [each + noise * rng.standard_normal(each.shape) for each in values]


def wave(x):
    return np.sin(3.0 * x * TIMES) * np.exp(x)


def slope(x):
    return np.exp(x) * (np.sin(3.0 * x * TIMES) + 3.0 * TIMES * np.cos(3.0 * x * TIMES))


def test_a_smooth_function_settles_everywhere_within_its_error():
    found = central(*both(wave, 1.0, 4e-3), 4e-3, 1.0, 1e-4)
    assert found.settled.all()
    assert (np.abs(found.value - slope(1.0)) <= found.error + 1e-12).all()
    assert np.abs(found.value - slope(1.0)).max() < 1e-8


@pytest.mark.parametrize("noise", [1e-11, 1e-9, 1e-7])
def test_the_error_covers_the_noise(noise):
    wrong, total = 0, 0
    for seed in range(20):
        found = central(*both(wave, 1.0, 4e-3, noise, seed), 4e-3, 1.0, 1e-4)
        wrong += (np.abs(found.value - slope(1.0)) > found.error).sum()
        total += len(TIMES)
        assert found.error.max() < 500.0 * noise / 4e-3 + 1e-5
    assert wrong < 0.01 * total


@pytest.mark.parametrize("place", [0.0, 1e-5, 1e-4, 5e-4, 2e-3, 3.9e-3])
def test_a_kink_within_the_steps_is_no_number_that_is_wrong(place):
    """At every second time the slope changes by 1 at 1 + `place`: both slopes are right off it, none is at it."""
    kinked = np.arange(len(TIMES)) % 2 == 0

    def function(x):
        return wave(x) + np.where(kinked, np.maximum(x - 1.0 - place, 0.0), 0.0)

    found = central(*both(function, 1.0, 4e-3), 4e-3, 1.0, 1e-4)
    assert found.settled[~kinked].all()
    size = np.sqrt(np.mean(slope(1.0) ** 2))
    given = found.settled & kinked
    assert not given.any() or np.abs(found.value - slope(1.0))[given].max() < 3e-4 * size
    if place == 0.0:
        assert not given.any()
    if place > 1.1e-3:  # the two finest steps do not reach it
        assert given.mean() > 0.45


def test_steps_of_a_counter_never_settle():
    found = central(*both(lambda x: np.round(wave(x) / 1e-3) * 1e-3, 1.0, 4e-3), 4e-3, 1.0, 1e-4)
    assert not found.settled[np.abs(slope(1.0)) > 0.5].any()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_a_limit_the_derivative_is_one_sided(side):
    found = one_sided(wave(1.0), three(wave, 1.0, 4e-3 * side), 4e-3 * side, 1.0, 1e-4)
    assert found.settled.all()
    assert (np.abs(found.value - slope(1.0)) <= found.error).all()
    assert np.abs(found.value - slope(1.0)).max() < 1e-5


def test_a_setting_without_effect_has_the_derivative_0():
    rng = np.random.default_rng(0)
    base = wave(1.0)
    up, down = (base + 1e-11 * rng.standard_normal((3, *base.shape)) for _ in range(2))
    found = central(base, up, down, 4e-3, 1.0, 1e-4)
    assert found.settled.all()
    assert np.abs(found.value).max() < 1e-7
