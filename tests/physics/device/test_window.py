"""Place and velocity between the steps of an encoder, against a search through all windows and numpy's own line."""

import numpy as np
import pytest
from pytest import approx

from palpate.physics.device.window import LENGTH, REST, buffers, forget, settle, smooth

STEP = 1e-5


def longest(times, places, before):
    """Differences in the longest straight window that is at most one longer than the one before."""
    for n in range(min(before + 1, len(times) - 1, LENGTH), 1, -1):
        t, p = times[-n - 1 :], places[-n - 1 :]
        chord = p[0] + np.outer((t - t[0]) / (t[-1] - t[0]), p[-1] - p[0])
        if np.all(np.linalg.norm(p - chord, axis=1) <= STEP):
            return n
    return min(1, len(times) - 1)


def hand(seed, count=120):
    """Irregular times [s] and places [m] (n,3) in encoder steps of a hand that rests, moves and turns."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5e-3, 2e-3, count)) + 3.0
    velocity = np.repeat(rng.choice((-0.02, -0.001, 0.0, 0.002, 0.05), (count // 30, 3)), 30, axis=0)
    places = 0.1 + np.cumsum(velocity * np.diff(times, prepend=times[0])[:, None], axis=0)
    return times, STEP * np.round(places / STEP)


@pytest.mark.parametrize("seed", range(4))
def test_a_line_of_least_squares_through_the_longest_straight_window(seed):
    times, places = hand(seed)
    cursor, ring, _ = buffers()
    n, seen = 0, set()
    for i, (t, place) in enumerate(zip(times, places, strict=True)):
        *told, window = settle(cursor, ring, t, *place, STEP)
        n = longest(times[: i + 1], places[: i + 1], n)
        assert window == n
        seen.add(n)
        if n < 2:
            assert told == [*place, 0.0, 0.0, 0.0]
            continue
        slope, end = np.polyfit(times[i - n : i + 1] - t, places[i - n : i + 1] - place, 1)
        assert told[:3] == approx(place + np.clip(end, -STEP / 2, STEP / 2), abs=1e-12)
        assert told[3:] == approx(slope, abs=1e-9)
    assert {1, 2, LENGTH} <= seen


@pytest.mark.parametrize("axis", range(3))
def test_a_sample_one_step_off_the_chord_is_still_on_it(axis):
    """The tolerance is the step, in each direction and in their sum of squares."""
    for off, window in ((0.999, 2), (1.001, 1)):
        cursor, ring, _ = buffers()
        for t, error in ((0.0, 0.0), (1e-3, off * STEP), (2e-3, 0.0)):
            place = np.zeros(3)
            place[axis] = error
            *_, n = settle(cursor, ring, t, *place, STEP)
        assert n == window
    cursor, ring, _ = buffers()
    for t, error in ((0.0, 0.0), (1e-3, 0.8 * STEP), (2e-3, 0.0)):
        *_, n = settle(cursor, ring, t, error, error, error, STEP)
    assert n == 1


def test_the_velocity_comes_from_a_long_window_alone():
    """Even motion: the filter's own velocity (here a mark) up to a window of `REST`, that of the line from there on."""
    cursor, ring, line = buffers()
    for i in range(LENGTH + 4):
        sample = (0.01 * i * 1e-3, 0.0, 0.0, 7.0, 8.0, 9.0, 1e-3)
        told = smooth(cursor, ring, line, i * 1_000_000, sample, STEP)
        assert told[:3] == approx(sample[:3], abs=1e-12) and told[6] == 1e-3
        assert told[3:6] == (approx((0.01, 0.0, 0.0), abs=1e-9) if i >= REST else (7.0, 8.0, 9.0))


def test_the_place_is_on_the_line_from_the_first_sample_on():
    """At rest between two steps, behind zero: the place does not jump to and fro as the samples do."""
    cursor, ring, line = buffers()
    one = (-0.1, 0.0, 0.0, 7.0, 8.0, 9.0)
    smooth(cursor, ring, line, 0, (*one, 1e-3), STEP)
    assert smooth(cursor, ring, line, 0, (*[9.0] * 6, 0.0), STEP) == (*one[:3], 9.0, 9.0, 9.0, 0.0)
    for i in range(1, REST):
        sample = (-0.1 + STEP * (i % 2), 0.0, 0.0, 7.0, 8.0, 9.0, 1e-3)
        told = smooth(cursor, ring, line, i * 1_000_000, sample, STEP)
        assert told[3:6] == (7.0, 8.0, 9.0)
        if i > 1:
            assert 0.0 < abs(told[0] - sample[0]) <= STEP / 2


def test_a_sample_without_time_changes_nothing_and_exact_positions_pass_as_they_are():
    cursor, ring, line = buffers()
    held = (0.1, 0.2, 0.3, 4.0, 5.0, 6.0, 0.0)
    assert smooth(cursor, ring, line, 0, held, STEP) == held  # nothing was taken yet
    for i in range(12):
        smooth(cursor, ring, line, i * 1_000_000, (1e-5 * i, 2e-5 * i, 3e-5 * i, 0.0, 0.0, 0.0, 1e-3), STEP)
    kept = line.copy(), cursor.copy()
    told = smooth(cursor, ring, line, 20_000_000, held, STEP)
    assert told == (*kept[0][:6], 0.0)
    assert np.array_equal(line, kept[0]) and np.array_equal(cursor, kept[1])
    moving = (*held[:6], 1e-3)
    cursor, ring, line = buffers()
    assert [smooth(cursor, ring, line, i, moving, 0.0) for i in range(12)] == [moving] * 12


def test_after_forgetting_it_begins_anew():
    cursor, ring, line = buffers()
    for i in range(12):
        smooth(cursor, ring, line, i * 1_000_000, (1e-5 * i, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3), STEP)
    forget(cursor, line)
    assert np.array_equal(cursor, buffers()[0]) and np.array_equal(line, buffers()[2])
    sample = (0.5, 0.0, 0.0, 1.0, 2.0, 3.0, 1e-3)
    assert smooth(cursor, ring, line, 20_000_000, sample, STEP) == sample
