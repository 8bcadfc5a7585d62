"""The velocity filter against its closed response, and bad time stamps."""

import numpy as np
import pytest
from formulas import velocity
from pytest import approx
from theory.velocity_response import half_power, magnitude

from palpate.physics.device.velocity import buffers, mean_velocity, push

RATE = 1025.0


def stamps(count: int, rate: float = RATE) -> np.ndarray:
    return np.round(np.arange(count) * 1e9 / rate).astype(np.int64)


def gain(frequency: float, order: int) -> complex:
    """Complex ratio of the filter to a single difference on a sine, by a least-squares fit to the steady part."""
    times = stamps(4000)
    seconds = times * 1e-9
    positions = np.zeros((4000, 3))
    positions[:, 0] = np.sin(2 * np.pi * frequency * seconds)
    basis = np.exp(2j * np.pi * frequency * seconds[100:])
    basis = np.column_stack((basis.real, basis.imag))

    def phasor(n):
        a, b = np.linalg.lstsq(basis, velocity(times, positions, n)[100:, 0], rcond=None)[0]
        return a - 1j * b

    return phasor(order) / phasor(1)


@pytest.mark.parametrize("frequency", [3.0, 30.0, 57.1, 110.0, 200.0, 400.0])
@pytest.mark.parametrize("order", [2, 5, 8])
def test_the_filter_has_the_closed_response(frequency, order):
    assert abs(gain(frequency, order)) == approx(float(magnitude(frequency, RATE, order)), abs=2e-6)


def test_null_and_half_power_of_eight_differences():
    assert half_power(RATE) == approx(0.44596 * RATE / 8, rel=1e-5)
    assert half_power(RATE) == approx(57.1, abs=0.05)
    assert [half_power(f) for f in (878.0, 1265.0)] == approx([48.9, 70.5], abs=0.05)
    assert float(magnitude(RATE / 8, RATE)) == approx(0.0, abs=1e-12)
    assert float(magnitude(110.0, 878.0)) < 0.01  # quoted as the cut-off: it is the null
    assert magnitude([0.0, RATE, 1e-9], RATE) == approx([1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="order 1"):
        half_power(RATE, 1)


def test_the_mean_delays_by_three_and_a_half_samples():
    assert np.degrees(np.angle(gain(30.0, 8))) == approx(-36.9, abs=0.05)


def test_one_position_step_in_the_velocity():
    def largest(order):
        positions = np.zeros((40, 3))
        positions[20:, 2] = 60e-6
        return velocity(stamps(40), positions, order).max()

    assert largest(1) == approx(61.5e-3, rel=2e-3)
    assert largest(8) == approx(7.7e-3, rel=2e-3)


def test_constant_velocity_is_exact_on_irregular_stamps():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.integers(790_000, 1_140_000, 200))
    positions = np.outer(times * 1e-9, (0.1, -0.2, 0.3))
    assert velocity(times, positions)[1:] == approx(np.tile((0.1, -0.2, 0.3), (199, 1)), rel=1e-9)


def test_a_long_gap_is_measured_not_assumed():
    times = np.append(stamps(20, 1000.0), 19_000_000 + 500_000_000)
    positions = np.zeros((21, 3))
    positions[20, 0] = 0.05
    assert velocity(times, positions, 1)[20, 0] == approx(0.1)


def test_stale_doubled_and_reordered_stamps_leave_the_velocity_alone():
    state = buffers(8)
    for k in range(20):
        push(*state, k * 1_000_000, 1e-4 * k, 0.0, 0.0)
    for t in (19_000_000, 18_000_000, 0, -5):
        assert push(*state, t, 0.5, 0.5, 0.5) == 0.0
        assert mean_velocity(*state) == approx((0.1, 0.0, 0.0))
    assert push(*state, 20_000_000, 2e-3, 0.0, 0.0) == approx(1e-3)
    assert mean_velocity(*state) == approx((0.1, 0.0, 0.0))


def test_a_clock_set_back_begins_a_new_history():
    state = buffers(4)
    for k in range(10):
        push(*state, 10**12 + k * 1_000_000, 1.0, 0.0, 0.0)
    periods = [push(*state, k * 1_000_000, 1e-4 * k, 0.0, 0.0) for k in range(12)]
    assert periods[-1] == approx(1e-3)
    assert mean_velocity(*state)[0] == approx(0.1)


def test_stale_stamps_count_anew_after_a_good_one_and_only_as_many_as_the_filter_is_long_are_believed():
    state = buffers(4)
    push(*state, 10**12, 0.0, 0.0, 0.0)
    for k in (1, 2):
        for early in range(4):
            assert push(*state, early, 9.0, 9.0, 9.0) == 0.0
        assert push(*state, 10**12 + k * 1_000_000, 1e-4 * k, 0.0, 0.0) == approx(1e-3)
    assert mean_velocity(*state) == approx((0.1, 0.0, 0.0))
    for early in range(5):
        push(*state, early, 9.0, 9.0, 9.0)
    assert mean_velocity(*state) == (0.0, 0.0, 0.0)
    assert push(*state, 1_000_004, 9.0, 9.0, 9.2) == approx(1e-3)
    assert mean_velocity(*state) == approx((0.0, 0.0, 200.0))


def test_no_velocity_from_one_sample():
    state = buffers(8)
    assert mean_velocity(*state) == (0.0, 0.0, 0.0)
    assert push(*state, 7, 1.0, 2.0, 3.0) == 0.0
    assert mean_velocity(*state) == (0.0, 0.0, 0.0)
