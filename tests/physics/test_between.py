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


def test_what_moves_is_told_as_it_is_read():
    """Faster than a step in 20 ms, along each axis, down and up."""
    t = DT * np.arange(300)[:, None]
    for speed in (3.0, 40.0):
        told, read = follow(STEP * speed / 0.04 * np.hypot(t - 0.15, 0.03) * (1.0, -1.0, 1.5))
        moving = np.abs(t[:, 0] - 0.15) > 0.05 + 2 * 0.04 / speed
        assert np.array_equal(told[moving], read[moving])
        assert np.abs(told - read).max() < STEP


def test_the_first_reading_outside_counts_at_once():
    places = np.zeros((200, 3))
    places[1::2] = STEP
    places[120:] = 2.0 * STEP
    told, read = follow(places)
    assert np.array_equal(told[120], read[120])


def test_no_reading_is_told_as_further_away_than_a_step():
    places = np.cumsum(np.random.default_rng(4).normal(0.0, 0.3 * STEP, (3000, 3)), axis=0)
    told, read = follow(places)
    assert np.abs(told - read).max() < 1.0 * STEP
    assert np.any(told != read)
