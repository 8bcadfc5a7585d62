"""The observer of the position between encoder counts, tested with exactly known motions and in closed loops.

Bounds follow from its constants; q is a count and w the bandwidth. x differs from the reading by less than

    1 q        at rest: the mean is taken within a count of the reading;
    2 q        at the end of a rest, by one more count: 1.5 q from the true position, which has just entered the cell of
               the reading;
    4j/w^3     with a jerk j, the error of its four poles; 0.55 V/w after a step V of the speed, the largest value of
               (t + t^2 - t^3/2) e^-t, and 0.91 a/w^2 after a step a of the acceleration, that of (t^2 + t^3)/2 e^-t,
               both in time 1/w. Beyond a count w grows as (d/q)^1.5, so that (d/q)^4 = 0.91 a/(w^2 q); for a moment the
               error may be twice as large.

A step d of the input of x causes a speed of at most 1.26 w d, the peak of its impulse response h; an error within d
causes at most 2.99 w d, the integral of |h'|. At the end of a rest d is 1.25 q: a count of the reading and half of the
one that fades meanwhile, less the quarter of a count that agrees with the reading.
"""

import numpy as np
import pytest

from palpate.compiler.fields import blank_record
from palpate.physics.device.observer import AXIS, BANDWIDTH, FAR, REST, begin, follow

COUNT = 60e-6
RATES = (500, 1000, 2000, 5000, 10_000)
PHASES = (0.0, 0.21, 0.5, 0.83)
JITTER = 0.3  # [1] jitter of the time between two samples of the real clock


def observed(motion, rate, seconds, phase=0.0, jitter=0.0):
    """Times [s], true positions [m], observed positions and speeds, and the readings, at the rate [Hz]."""
    steps = (1.0 + jitter * np.random.default_rng(rate).uniform(-1.0, 1.0, round(rate * seconds))) / rate
    t = np.cumsum(steps)
    true = motion(t)
    axis, places, speeds = blank_record(AXIS), [], []
    read = COUNT * (np.round(true / COUNT + phase) - phase)
    begin(axis, read[0])
    for reading, dt in zip(read, steps, strict=True):
        before = axis.position
        places.append(follow(axis, reading, COUNT, dt))
        speeds.append((places[-1] - before) / dt)
    return t, true, np.array(places), np.array(speeds), read


def minimum_jerk(s):
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s * s)


def tremor(t):
    return 30e-6 * sum(np.sin(2 * np.pi * f * t + 2.0 * f) for f in (1.1, 2.3, 3.9, 5.3, 7.1, 9.7))


@pytest.mark.parametrize("jitter", [0.0, JITTER])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("speed", [0.01, -0.037, 0.2])
def test_a_uniform_motion_is_followed_without_lag(rate, speed, jitter):
    """Of the quantization error of half a count, 25 % remains."""
    t, true, places, speeds, _ = observed(lambda t: speed * t, rate, 0.5, 0.3, jitter)
    late = t > 0.2
    assert np.abs(places - true)[late].max() < 0.75 * COUNT
    assert np.abs(speeds[late] - speed).max() < 2.99 * BANDWIDTH * 0.25 * COUNT
    assert abs(np.polyfit(t[late], places[late], 1)[0] / speed - 1.0) < 0.01


def of_jerk(jerk):
    """Error [m] by a jerk [m/s3]."""
    return 4.0 * jerk / BANDWIDTH**3


def of_corner(step):
    """Error [m] by a step of the speed [m/s]."""
    return 0.55 * step / BANDWIDTH


HAND = {  # motion, seconds, largest error [m] by its jerk or corner
    "reach": (lambda t: 0.022 * minimum_jerk(t / 0.5), 1.0, of_jerk(60 * 0.022 / 0.5**3)),
    "leaving a rest": (lambda t: 0.022 * minimum_jerk((t - 0.5) / 0.5), 1.0, of_jerk(60 * 0.022 / 0.5**3)),
    "slow press": (lambda t: 2e-3 * np.maximum(t - 0.3, 0.0), 1.5, of_corner(2e-3)),
    "very slow press": (lambda t: 0.3e-3 * np.maximum(t - 0.3, 0.0), 2.0, of_corner(0.3e-3)),
    "to and fro": (lambda t: 2e-3 * np.sin(2 * np.pi * 2 * t), 1.0, of_jerk(2e-3 * (4 * np.pi) ** 3)),
    "quickly to and fro": (lambda t: 1e-3 * np.sin(2 * np.pi * 8 * t), 0.5, of_jerk(1e-3 * (16 * np.pi) ** 3)),
    "tremor": (tremor, 2.0, of_jerk(30e-6 * sum((2 * np.pi * f) ** 3 for f in (1.1, 2.3, 3.9, 5.3, 7.1, 9.7)))),
    "coming to rest": (lambda t: 4e-3 * (1 - np.exp(-t / 0.1)), 1.0, of_jerk(4e-3 / 0.1**3)),
}


@pytest.mark.parametrize("jitter", [0.0, JITTER])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", HAND)
def test_a_motion_of_a_hand_is_followed_within_counts_without_a_jump(name, rate, jitter):
    motion, seconds, lag = HAND[name]
    for phase in PHASES:
        t, true, places, speeds, read = observed(motion, rate, seconds, phase, jitter)
        late = t > 0.05  # the observer starts at rest, these motions do not
        way = np.abs(np.diff(true, prepend=true[0]))  # of the true position in one step
        assert np.all(np.abs(places - true)[late] < 1.5 * COUNT + lag + way[late])
        assert np.all(np.abs(places - read)[late] < 2.0 * COUNT + lag + way[late])
        if lag < 0.25 * COUNT:
            exact = np.gradient(true, t)
            assert np.abs(speeds - exact)[late].max() < 1.26 * BANDWIDTH * (1.25 * COUNT + lag)


@pytest.mark.parametrize("rate", RATES)
def test_a_sudden_stop_is_followed_within_15_ms(rate):
    """A motion of 0.3 m/s stops at a wall."""
    t0, brake = 0.1, 20.0

    def stop(t):
        s = np.clip(t - t0, 0.0, 0.3 / brake)
        return 0.3 * np.minimum(t, t0) + 0.3 * s - 0.5 * brake * s * s

    late = 2.0 * (0.91 * brake / BANDWIDTH**2 / COUNT) ** 0.25
    _, true, places, _, read = observed(stop, rate, 0.4)
    assert np.abs(places - true).max() < (0.25 + late) * COUNT
    assert np.abs(places - read).max() < (0.5 + late) * COUNT


@pytest.mark.parametrize("rate", RATES)
def test_a_reading_that_flips_between_two_counts_comes_to_rest(rate):
    """The rest is at the mean of the readings, within its standard error."""
    rng = np.random.default_rng(3)
    axis = blank_record(AXIS)
    begin(axis, 0.0)
    flips = rng.random(2 * rate) < 0.4
    places = np.array([follow(axis, COUNT * flip, COUNT, 1.0 / rate) for flip in flips])
    late = places[rate:]
    assert abs(late.mean() / COUNT - 0.4) < 3.0 * np.sqrt(0.24 / rate)
    assert np.ptp(late) < 6.0 * np.sqrt(0.24 / rate) * COUNT and np.abs(np.diff(late)).sum() < COUNT


def held(stiffness, rate, phase, jitter=0.0, exact=False, damping=10.0):
    """Positions [m] of a grip of 0.2 kg, and forces [N], while a hand of 500 N/m presses into a spring and then
    holds."""
    steps = (1.0 + jitter * np.random.default_rng(rate).uniform(-1.0, 1.0, round(1.2 * rate))) / rate
    t = np.cumsum(steps)
    goal = 1e-3 - (1e-3 + 2.2 / 500.0 + 2.2 / stiffness) * minimum_jerk(t / 0.4)
    x, v, before, force, rows = 1e-3, 0.0, 1e-3, 0.0, []
    axis = blank_record(AXIS)
    begin(axis, COUNT * (round(x / COUNT + phase) - phase))
    for want, dt in zip(goal.tolist(), steps.tolist(), strict=True):
        h, rate_of_goal = dt / 2, (want - before) / dt
        for part in (0.5, 1.0):  # implicit in the hand
            pull = 500.0 * (before + part * (want - before) - x) + damping * (rate_of_goal - v) - 0.2 * v
            v += h * (force + pull) / (0.2 + h * (damping + 0.2) + h * h * 500.0)
            x += h * v
        before = want
        place = follow(axis, COUNT * (round(x / COUNT + phase) - phase), COUNT, dt)
        force = max(-stiffness * (x if exact else place), 0.0)
        rows.append((x, force))
    return t, *np.array(rows).T


@pytest.mark.parametrize("jitter", [0.0, JITTER])
@pytest.mark.parametrize("rate", [500, 1000, 10_000])
@pytest.mark.parametrize("stiffness", [250.0, 500.0, 1000.0, 1667.0])
def test_a_hand_holds_still_on_a_spring(stiffness, rate, jitter):
    """Up to the stiffest spring that the controller renders at this count, 0.1 N per count. The force error is at most
    that of 1.5 counts, and less than 30 mN RMS at rest."""
    *_, wanted = held(stiffness, rate, 0.0, jitter, exact=True)
    for phase in PHASES:
        t, _, force = held(stiffness, rate, phase, jitter)
        assert abs(force.max() - wanted.max()) < 1.5 * COUNT * stiffness
        assert np.std(force[t > 0.9]) < 0.03


def test_the_observer_is_symmetric_and_finite_for_any_reading():
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(0.0, 30 * COUNT, 4000)) * (rng.random(4000) < 0.2)
    read = COUNT * np.round(path / COUNT)
    one, other = blank_record(AXIS), blank_record(AXIS)
    begin(one, read[0])
    begin(other, -read[0])
    for reading, dt in zip(read, rng.choice([1e-6, 1e-4, 1e-3, 0.1, 10.0], len(read)), strict=True):
        place = follow(one, reading, COUNT, dt)
        assert place == -follow(other, -reading, COUNT, dt)
        assert np.isfinite(one.item()).all() and abs(place - reading) <= 1.0001 * FAR * COUNT


def test_readings_within_three_counts_are_a_rest_only_if_they_alternate():
    """Readings 1, 2, 1, 0, 1, ... are a rest at 1; 0, 1, 2 in a row never are, also if they are slow."""

    def last(readings):
        axis = blank_record(AXIS)
        begin(axis, 0.0)
        for count in readings:
            for _ in range(round(0.9 * REST * 1000)):
                place = follow(axis, count * COUNT, COUNT, 1e-3)
        return place / COUNT

    assert last([1, 2, 1, 0] * 10 + [1, 2]) == pytest.approx(1.0, abs=0.1)
    assert last(range(20)) == pytest.approx(19.0, abs=0.5)
