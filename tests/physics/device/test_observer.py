"""The observer between the counts of an encoder, against motions that are known exactly."""

import numpy as np
import pytest

from palpate.physics.device.observer import LOST, REST, begin, buffers, follow

COUNT = 60e-6


def observed(motion, rate, seconds, phase=0.0):
    """Times [s], true places [m], places and speeds that the observer finds at the rate [Hz]."""
    t = np.arange(round(rate * seconds)) / rate
    true = motion(t)
    axis, places, speeds = buffers()[0], [], []
    read = COUNT * np.round((true + phase * COUNT) / COUNT) - phase * COUNT
    begin(axis, read[0])
    for reading in read:
        before = axis[0]
        places.append(follow(axis, reading, COUNT, 1.0 / rate))
        speeds.append((places[-1] - before) * rate)
    return t, true, np.array(places), np.array(speeds), read


RATES = (500, 1000, 2000, 5000, 10_000)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("speed", [0.01, -0.037, 0.2])
def test_an_even_motion_is_followed_without_lag_and_without_counts(rate, speed):
    t, true, places, speeds, _ = observed(lambda t: speed * t, rate, 0.5, 0.3)
    late = t > 0.2
    assert np.abs(places - true)[late].max() < (0.75 if abs(speed) / rate < 2 * COUNT else 1.5) * COUNT
    assert np.abs(speeds[late] / speed - 1.0).max() < 0.1
    assert abs(speeds[late].mean() / speed - 1.0) < 0.01


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("phase", [0.0, 0.21, 0.5, 0.83])
def test_a_reach_and_its_end_at_rest(rate, phase):
    """Minimum jerk over 22 mm in 0.5 s, 0.5 m/s2: within a count, at every rate with the same error of the speed."""

    def reach(t):
        s = np.minimum(t / 0.5, 1.0)
        return 0.022 * s**3 * (10 - 15 * s + 6 * s * s)

    t, true, places, speeds, read = observed(reach, rate, 1.2, phase)
    assert np.abs(places - true).max() < 1.3 * COUNT
    assert np.abs(places - read).max() < 1.75 * COUNT
    exact = np.gradient(true, t)
    assert np.sqrt(np.mean((speeds - exact)[t < 0.5] ** 2)) < 3e-3
    rest = t > 0.5 + 2 * REST
    assert np.abs(np.diff(places[rest])).sum() < 0.5 * COUNT


@pytest.mark.parametrize("rate", RATES)
def test_a_sudden_stop_is_felt_at_once(rate):
    """0.3 m/s into a wall within 15 ms: 20 m/s2: a few counts off for some milliseconds."""
    t0, brake = 0.1, 20.0

    def stop(t):
        s = np.clip(t - t0, 0.0, 0.3 / brake)
        return 0.3 * np.minimum(t, t0) + 0.3 * s - 0.5 * brake * s * s

    _, true, places, *_ = observed(stop, rate, 0.4)
    assert np.abs(places - true).max() < 5.0 * COUNT


@pytest.mark.parametrize("rate", RATES)
def test_a_reading_that_flips_between_two_counts_comes_to_rest(rate):
    rng = np.random.default_rng(3)
    axis = buffers()[1]
    begin(axis, 0.0)
    places = [follow(axis, COUNT * (rng.random() < 0.4), COUNT, 1.0 / rate) for _ in range(rate)]
    assert np.ptp(places[rate // 2 :]) < 0.5 * COUNT


def test_a_vibration_faster_than_a_hand_keeps_its_mean_and_a_slow_one_is_followed():
    for frequency, kept in ((33.0, 0.15), (4.0, 0.9)):
        t, true, places, *_ = observed(lambda t, f=frequency: 4 * COUNT * np.sin(2 * np.pi * f * t), 1000, 2.0)
        swing = np.ptp(places[t > 1.0]) / np.ptp(true)
        assert swing < kept if frequency > 20.0 else swing > kept


def test_it_is_mirrored_with_the_motion_and_finite_whatever_it_reads():
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(0.0, 30 * COUNT, 4000)) * (rng.random(4000) < 0.2)
    read = COUNT * np.round(path / COUNT)
    one, other = buffers()[:2]
    begin(one, read[0])
    begin(other, -read[0])
    for reading, dt in zip(read, rng.choice([1e-6, 1e-4, 1e-3, 0.1, 10.0], len(read)), strict=True):
        place = follow(one, reading, COUNT, dt)
        assert place == -follow(other, -reading, COUNT, dt)
        assert np.isfinite(one).all() and abs(place - reading) <= LOST * COUNT
