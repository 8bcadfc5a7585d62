"""Samples of a device, checked and interpolated between counts: compared with plain lists and known motions."""

import math

import numpy as np
import pytest
from falcon_arrays import inverse
from pytest import approx

from palpate.compiler.fields import blank_record
from palpate.physics.device.average import READINGS
from palpate.physics.device.falcon import FALCON, HOME, forward_kernel
from palpate.physics.device.tracking import (
    ANEW,
    BAD,
    MOST_STALE,
    TAKEN,
    TRACK,
    judge,
    pose,
    pose_falcon,
    take,
)

MS, LIMIT = 1_000_000, 2.0
OBSERVED = np.zeros(1, READINGS)  # no moving average
STEP = 40e-6


def oracle(samples):
    """The class of each sample by the documented rules: too fast is rejected; four consistent ones in a row restart."""
    last, refused, stale, kinds = None, [], 0, []
    for t, place in samples:
        far = last and math.dist(place, last[1]) > LIMIT * (t - last[0]) * 1e-9 + 2e-4
        if not np.isfinite(place).all():
            kinds.append(BAD)
            continue
        if last is None:
            kinds.append(ANEW)
        elif t <= last[0]:
            stale += 1
            kinds.append(ANEW if stale == MOST_STALE else BAD)
        elif far:
            stale = 0
            near = refused and math.dist(place, refused[-1][1]) <= LIMIT * (t - refused[-1][0]) * 1e-9 + 2e-4
            refused = [*refused, (t, place)] if near else [(t, place)]
            kinds.append(ANEW if len(refused) == 4 else BAD)
        else:
            stale = 0
            kinds.append(TAKEN)
            refused = []
        if kinds[-1] != BAD:
            last, refused = (t, place), []
    return kinds


@pytest.mark.parametrize("seed", range(5))
def test_samples_are_rejected_accepted_or_restarted_by_the_rules(seed):
    """A hand with glitches of one to six samples in a row, stale time stamps and positions that are not numbers."""
    rng = np.random.default_rng(seed)
    samples, t, place, away = [], 1000, np.array([0.1, -0.2, 0.3]), np.zeros(3)
    glitch = 0
    for _ in range(600):
        t += int(rng.choice([0, 1, 2, 3], p=[0.03, 0.77, 0.1, 0.1])) * MS
        place = place + rng.uniform(-1e-3, 1e-3, 3)
        if glitch == 0:
            away, glitch = (rng.uniform(-0.05, 0.05, 3), int(rng.integers(1, 7))) if rng.random() < 0.1 else (0.0, 0)
        glitch = max(glitch - 1, 0)
        read = place + away
        if rng.random() < 0.02:
            read[rng.integers(3)] = rng.choice([math.nan, math.inf, -math.inf])
        samples.append((t, tuple(read)))
    track = fresh()
    kinds = []
    for t, read in samples:
        kinds.append(judge(track, LIMIT, t, *read))
        if kinds[-1] != BAD:
            take(track, kinds[-1], t, read, read)
    assert kinds == oracle(samples)
    assert min(kinds.count(kind) for kind in (BAD, TAKEN, ANEW)) > 5


def fresh(begin=(0.0, 0.0, 0.0)):
    """State of `pose` at a position [m] before the first sample."""
    return blank_record(TRACK, reading=begin, pose=begin)


def tracker(step=0.0, begin=(0.0, 0.0, 0.0)):
    """A function that follows time stamps [ns] and positions [m]."""
    state = fresh(begin)
    return lambda t, *place: pose(state, step, LIMIT, OBSERVED, t, place)


@pytest.mark.parametrize(("way", "taken"), [(2.0e-4, True), (2.03e-4, False)])
def test_a_motion_of_few_counts_is_accepted_for_any_time_step(way, taken):
    follow = tracker()
    follow(5 * MS, 0.0, 0.0, 0.0)
    seen = follow(5 * MS + 1000, way, 0.0, 0.0)
    assert seen == (approx((way, 0, 0, way / 1e-6, 0, 0, 1e-6)) if taken else (0.0,) * 7)


def test_an_accepted_jump_has_the_time_since_the_last_valid_sample_and_no_speed():
    follow = tracker()
    for k in range(5):  # starting with the first sample
        seen = follow(k * MS, 0.2 if k else 0.0, 0.0, 0.0)
    assert seen == approx((0.2, 0, 0, 0, 0, 0, 4e-3))
    follow = tracker()
    for k in range(6):
        seen = follow((7 + k) * MS, 1e-3 * k, 0.0, 0.0)
    assert seen == approx((5e-3, 0, 0, 1.0, 0, 0, 1e-3))
    for k in range(6, 9):
        assert follow((7 + k) * MS, 0.2, 0.0, 0.0) == approx((5e-3, 0, 0, 1.0, 0, 0, 0))
    assert follow(16 * MS, 0.2, 0.1, 0.0)[6] == 0.0  # the fourth is not consistent
    for k in range(3):
        assert follow((17 + k) * MS, 0.2, 0.1, 0.0)[6] == (approx(7e-3) if k == 2 else 0.0)
    assert follow(20 * MS, 0.201, 0.1, 0.0) == approx((0.201, 0.1, 0, 1.0, 0, 0, 1e-3))


def test_a_jump_restarts_the_observer():
    follow = tracker(STEP)
    for k in range(300):
        follow(k * MS, 0.1, 0.0, 0.0)
    for k in range(300, 304):
        seen = follow(k * MS, 0.2, 0.0, 0.0)
    assert seen == approx((0.2, 0, 0, 0, 0, 0, 4e-3))


def test_exact_positions_are_used_unchanged_with_their_last_difference():
    follow, rng = tracker(), np.random.default_rng(1)
    before = follow(0, 0.1, 0.2, 0.3)
    for k in range(1, 100):
        place = np.array(before[:3]) + rng.uniform(-1e-4, 1e-4, 3)
        seen = follow(k * MS, *place)
        assert seen[:3] == tuple(place) and seen[3:6] == approx((place - before[:3]) / 1e-3)
        before = seen


def test_samples_without_a_time_step_are_skipped_and_a_clock_set_back_restarts():
    follow = tracker(STEP)
    for k in range(5):
        good = follow((90 + k) * MS, 1e-3 * k, 0.0, 0.0)
    for _ in range(MOST_STALE - 1):
        assert follow(0, 9.0, 0.0, 0.0) == (*good[:6], 0.0)
    assert follow(1 * MS, 5e-3, 0.0, 0.0) == (5e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert follow(2 * MS, 5e-3, 0.0, 0.0)[6] == approx(1e-3)


def test_before_the_first_sample_the_pose_is_the_initial_one():
    assert tracker(begin=(0.1, 0.2, 0.3))(0, math.nan, 0.0, 0.0) == (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("resolution", [0.0, 60e-6])
def test_joint_angles_are_observed_only_if_the_device_has_a_resolution(resolution):
    """Angles that jump between two counts are used unchanged, or with a small part of the jumps."""
    geometry, count = FALCON.geometry, FALCON.count
    angles = np.round(inverse(HOME)[0][:, 0] / count) * count
    state = fresh(HOME)
    seen, read = [], []
    for k in range(300):
        joints = tuple(angles + count * (k % 3 == 0))
        seen.append(pose_falcon(state, resolution, LIMIT, OBSERVED, k * MS, joints, geometry)[:3])
        read.append(forward_kernel(geometry, *joints, *HOME)[1:])
    if resolution:
        assert np.ptp(seen[200:], axis=0).max() < 0.05 * np.ptp(read[200:], axis=0).max()
    else:
        assert np.array(seen) == approx(np.array(read), abs=1e-12)
    held = pose_falcon(state, resolution, LIMIT, OBSERVED, 301 * MS, (9.0, 9.0, 9.0), geometry)
    assert held[:3] == seen[-1] and held[6] == 0.0  # angles without a position
