"""Samples of a device, judged and rested: against plain lists, and against a place that is read in steps."""

import math

import numpy as np
import pytest
from pytest import approx

from palpate.physics.device import between, window
from palpate.physics.device.falcon import FALCON, HOME, forward_kernel, inverse
from palpate.physics.device.tracking import ANEW, BAD, TAKEN, buffers, judge, pose_falcon, take, track, track_falcon

MS, LIMIT, ORDER = 1_000_000, 2.0, 3
STEP = 40e-6


def oracle(samples):
    """What each sample is, from the text: too fast is refused, four in a row that agree begin anew."""
    last, refused, kinds = None, [], []
    for t, place in samples:
        far = last and math.dist(place, last[1]) > LIMIT * (t - last[0]) * 1e-9 + 2e-4
        if not np.isfinite(place).all():
            kinds.append(BAD)
        elif last is None:
            kinds.append(ANEW)
        elif t <= last[0]:
            kinds.append(TAKEN)
        elif far:
            near = refused and math.dist(place, refused[-1][1]) <= LIMIT * (t - refused[-1][0]) * 1e-9 + 2e-4
            refused = [*refused, (t, place)] if near else [(t, place)]
            kinds.append(ANEW if len(refused) == 4 else BAD)
        else:
            kinds.append(TAKEN)
            refused = []
        if kinds[-1] == ANEW:
            refused = []
        if kinds[-1] == ANEW or (kinds[-1] == TAKEN and t > last[0]):
            last = t, place
    return kinds


@pytest.mark.parametrize("seed", range(5))
def test_what_is_refused_taken_or_believed_anew(seed):
    """A hand among glitches of one to six samples in a row, stale stamps and places that are no numbers."""
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
    cursor, times, points = buffers(ORDER, 0.0, 0.0, 0.0)
    kinds = []
    for t, read in samples:
        kinds.append(judge(cursor, times, points, LIMIT, t, *read))
        if kinds[-1] != BAD:
            take(cursor, times, points, kinds[-1], t, *read)
    assert kinds == oracle(samples)
    assert min(kinds.count(kind) for kind in (BAD, TAKEN, ANEW)) > 5


@pytest.mark.parametrize(("way", "taken"), [(2.0e-4, True), (2.03e-4, False)])
def test_a_few_counts_pass_whatever_the_time_between(way, taken):
    state = (*buffers(ORDER, 0.0, 0.0, 0.0), between.buffers())
    track(*state, 0.0, LIMIT, 5 * MS, 0.0, 0.0, 0.0)
    told = track(*state, 0.0, LIMIT, 5 * MS + 1000, way, 0.0, 0.0)
    assert told == (approx((way, 0, 0, way / 1e-6, 0, 0, 1e-6)) if taken else (0.0,) * 7)


def test_a_jump_that_is_believed_gives_the_time_since_the_last_good_sample_and_no_speed():
    state = (*buffers(ORDER, 0.0, 0.0, 0.0), between.buffers())
    for k in range(5):  # from the very first one on
        told = track(*state, 0.0, LIMIT, k * MS, 0.2 if k else 0.0, 0.0, 0.0)
    assert told == approx((0.2, 0, 0, 0, 0, 0, 4e-3))
    state = (*buffers(ORDER, 0.0, 0.0, 0.0), between.buffers())
    for k in range(6):
        told = track(*state, 0.0, LIMIT, 7 * MS + k * MS, 1e-3 * k, 0.0, 0.0)
    assert told == approx((5e-3, 0, 0, 1.0, 0, 0, 1e-3))
    for k in range(6, 9):
        assert track(*state, 0.0, LIMIT, 7 * MS + k * MS, 0.2, 0.0, 0.0) == approx((5e-3, 0, 0, 1.0, 0, 0, 0))
    assert track(*state, 0.0, LIMIT, 16 * MS, 0.2, 0.1, 0.0)[6] == 0.0  # the fourth does not agree
    for k in range(3):
        assert track(*state, 0.0, LIMIT, (17 + k) * MS, 0.2, 0.1, 0.0)[6] == (approx(7e-3) if k == 2 else 0.0)
    assert track(*state, 0.0, LIMIT, 20 * MS, 0.201, 0.1, 0.0) == approx((0.201, 0.1, 0, 1.0, 0, 0, 1e-3))


def rest(follow, low, high, base=0):
    """What is told of readings that jump to and fro between two, 300 of them [ms]."""
    return np.array([follow((base + k) * MS, *(high if k % 2 else low))[:3] for k in range(300)])


def test_a_place_at_rest_between_two_steps_is_their_mean_and_a_jump_begins_anew():
    state = (*buffers(ORDER, 0.0, 0.0, 0.0), between.buffers())

    def follow(t, x, y, z):
        return track(*state, STEP, LIMIT, t, x, y, z)

    one = np.array([0.1, -0.2, 0.3])
    told = rest(follow, one, one + STEP)
    read = one + STEP * (np.arange(50) % 2)[:, None]
    assert told[:50] == approx(read, abs=1e-15)  # a rest is one after 50 ms
    assert told[-1] == approx(one + STEP / 2, abs=0.03 * STEP)
    stale = follow(299 * MS, *(one + STEP))
    assert stale[6] == 0.0
    away = one + 0.1
    told = rest(follow, away, away + STEP, base=300)
    assert told[2] == approx(one + STEP / 2, abs=0.03 * STEP)  # not believed yet
    assert told[3:50] == approx(read[3:] + 0.1, abs=1e-15)  # as it is read
    assert told[-1] == approx(away + STEP / 2, abs=0.03 * STEP)


def test_exact_places_and_samples_without_time_are_told_as_they_are_read():
    for step, dt in ((0.0, MS), (STEP, 0)):
        state = (*buffers(ORDER, 0.0, 0.0, 0.0), between.buffers())
        track(*state, step, LIMIT, 0, 0.1, 0.2, 0.3)
        before = state[3].copy()
        for k in range(1, 100):
            track(*state, step, LIMIT, k * dt, 0.1 + STEP * (k % 2), 0.2, 0.3)
        assert np.array_equal(state[3], before)


def test_an_arm_at_rest_between_two_counts_is_where_their_mean_angles_put_it():
    geometry, count = FALCON.geometry, FALCON.count
    angles = np.round(inverse(HOME)[0][:, 0] / count) * count
    for moved in ((1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
        state = (*buffers(ORDER, *HOME), between.buffers())

        def follow(t, *joints, state=state):
            return track_falcon(*state, count, geometry, LIMIT, t, *joints)

        low, high = angles, angles + count * np.array(moved)
        told = rest(follow, low, high)
        ok, *mean = forward_kernel(geometry, *((low + high) / 2), *HOME)
        assert ok and told[-1] == approx(mean, abs=2e-7)
        held = follow(301 * MS, 9.0, 9.0, 9.0)  # angles that no place has
        assert held[:3] == tuple(told[-1]) and held[6] == 0.0


def test_before_the_first_sample_the_pose_stands_where_it_was_put():
    state = (*buffers(ORDER, 0.1, 0.2, 0.3), between.buffers())
    assert track(*state, 0.0, LIMIT, 0, math.nan, 0.0, 0.0) == (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0)


def test_a_clock_set_back_begins_anew_after_as_many_samples_as_the_filter_has():
    state = (*buffers(ORDER, 0.0, 0.0, 0.0), between.buffers())
    for k in range(5):
        track(*state, 0.0, LIMIT, (90 + k) * MS, 1e-3 * k, 0.0, 0.0)
    told = [track(*state, 0.0, LIMIT, k * MS, 5e-3, 0.0, 0.0) for k in range(6)]
    assert [pose[0] for pose in told] == [4e-3] * ORDER + [5e-3] * 3
    assert [pose[6] for pose in told] == approx([0.0] * (ORDER + 1) + [1e-3] * 2)


@pytest.mark.parametrize("resolution", [0.0, 60e-6])
def test_joint_angles_are_rested_only_where_the_device_has_a_resolution(resolution):
    geometry, count = FALCON.geometry, FALCON.count
    angles, steady = np.round(inverse(HOME)[0][:, 0] / count) * count, window.buffers()
    state, cell = buffers(ORDER, *HOME), between.buffers()
    told, read = [], []
    for k in range(300):
        joints = angles + count * (k % 3 == 0)
        falcon = count, geometry
        told.append(pose_falcon(*state, cell, *steady, resolution, LIMIT, k * MS, joints, falcon)[:3])
        read.append(forward_kernel(geometry, *joints, *HOME)[1:])
    if resolution:
        assert np.ptp(told[200:], axis=0).max() < 0.01 * np.ptp(read[200:], axis=0).max()
    else:
        assert np.array(told) == approx(np.array(read), abs=1e-12)
