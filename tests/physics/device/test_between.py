"""A reading that rests between two steps of its encoder, and one that moves."""

import numpy as np
from pytest import approx

from palpate.physics.device.between import BLEND, REST, begin, buffers, settle

STEP = 40e-6
DT = 1e-3


def follow(places):
    """What is told of places (n,3) that are read in whole steps, and the readings."""
    cell, read = buffers(), STEP * np.rint(np.asarray(places) / STEP)
    begin(cell, *read[0])
    return np.array([settle(cell, *r, STEP, DT) for r in read]), read


def test_what_rests_between_two_steps_is_told_as_their_mean():
    """A quarter of the readings are the upper step: a place a quarter of a step above the lower one."""
    t = np.arange(400)
    places = STEP * np.where(t % 4 == 0, 7.2, 5.9)[:, None] * np.ones(3)
    told, _ = follow(places)
    late = told[t * DT > REST + BLEND]
    assert np.ptp(late) < 0.02 * STEP
    assert late.mean() == approx(6.25 * STEP, abs=0.02 * STEP)


def test_what_moves_is_told_as_it_is_read_once_the_rest_before_has_faded():
    """Faster than a step in 20 ms, along each axis, down and up."""
    t = DT * np.arange(400)[:, None]
    for speed in (3.0, 40.0):
        told, read = follow(STEP * speed / 0.04 * np.hypot(t - 0.2, 0.03) * (1.0, -1.0, 1.5))
        since = np.abs(t[:, 0] - 0.2) - 0.05 - 2 * 0.04 / speed
        late = since > 6 * BLEND
        assert late.sum() > 100 and np.abs(told - read)[late].max() < 2.0 * STEP * np.exp(-6)
        assert np.abs(told - read).max() < 2.0 * STEP


def test_after_a_rest_a_movement_counts_at_once_and_where_it_rested_fades():
    """One reading beyond the two that it rested between, and then even motion: no jump, and no lag in what changes."""
    places = np.zeros((200, 3))
    places[1:120:2] = STEP
    places[120:] = STEP * (2.0 + np.arange(80)[:, None])
    told, read = follow(places)
    mean = told[119]
    assert np.abs(mean - 0.5 * STEP).max() < 0.05 * STEP
    assert np.abs(told[120] - mean).max() < 1e-9 * STEP, "leaving is no jump"
    away = read[120:] - told[120:]
    assert away == approx(away[0] * np.exp(-DT * np.arange(80)[:, None] / BLEND), abs=1e-9 * STEP)


def test_no_reading_is_told_as_further_away_than_two_steps():
    places = np.cumsum(np.random.default_rng(4).normal(0.0, 0.3 * STEP, (3000, 3)), axis=0)
    told, read = follow(places)
    assert np.abs(told - read).max() < 2.0 * STEP
    assert np.any(told != read)


def test_a_reading_far_from_where_it_rested_counts_at_once():
    """As after an outage in which the finger moved on: were its whole way to fade in over 10 ms, it would seem fast."""
    places = np.zeros((200, 3))
    places[120:] = STEP * np.array([80.0, -80.0, 2.0])
    told, read = follow(places)
    assert np.abs(told - read).max() <= (2.0 + 1e-9) * STEP
    assert told[150] == approx(read[150], abs=2.0 * STEP * np.exp(-2.9))
