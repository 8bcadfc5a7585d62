"""The last step before the wire: limits, gains and the reasons to give no force."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pytest import approx

from palpate.drivers.guard import FALL, HORIZON, MISSED, SILENT, STALE, DeviceSample, Guard, ahead
from palpate.drivers.limits import LIMITS, Limits

MS = 1_000_000
WIDE = Limits(command=4.0, power=100.0, speed=1.0, box=((-1.0,) * 3, (1.0,) * 3), ramp=0.1)
NUMBER = st.floats(allow_nan=True, allow_infinity=True)


def run(guard, count, command=(1.0, 0.0, 0.0), start=1, sample=None, age=0):
    """Feed a cycle a millisecond; the command that would be sent in each."""
    sent = []
    for k in range(start, start + count):
        now = k * MS
        sent.append(guard.apply(command, now, now - age))
        given = DeviceSample(now, position=(0.0, 0.0, 0.0)) if sample is None else sample(now)
        guard.saw(given)
    return sent


def test_the_force_comes_in_over_the_ramp():
    sent = run(Guard(WIDE), 200)
    x = [c[0] for c in sent]
    assert x[0] == 0.0 and x[-1] == 1.0
    assert np.all(np.diff(x) >= 0.0) and max(np.diff(x)) == approx(0.01, rel=1e-6)
    assert 95 <= sum(v < 1.0 for v in x) <= 105


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("answers are missing", {"sample": lambda now: None}),
        ("the command is old", {"age": round(STALE * 1e9) + 1}),
        ("not homed", {"sample": lambda now: DeviceSample(now, homed=False)}),
        ("outside its box", {"sample": lambda now: DeviceSample(now, position=(0.0, 0.0, 2.0))}),
    ],
)
def test_trouble_takes_the_force_away_within_20_ms(name, spoil):
    guard = Guard(WIDE)
    run(guard, 300)
    assert guard.gain == 1.0
    sent = run(guard, 40, start=301, **spoil)
    assert guard.why(340 * MS, 340 * MS - spoil.get("age", 0)) == name
    first = next(i for i, c in enumerate(sent) if c[0] < 1.0)
    none = next(i for i, c in enumerate(sent) if c[0] == 0.0)
    assert none - first <= 20 and first <= MISSED + 1
    assert all(c == (0.0, 0.0, 0.0) for c in sent[none:])
    assert run(guard, 150, start=500)[-1] == (1.0, 0.0, 0.0), "it comes in again when all is well"


@pytest.mark.parametrize("without", range(12, 30, 3))
@pytest.mark.parametrize("after", [0.0, -1.0, 3.0])
def test_the_command_never_jumps_around_an_outage(without, after):
    """Also if another command comes while the last one still falls to 0."""
    guard = Guard(WIDE)
    run(guard, 300)
    old = [guard.apply((1.0, 0.0, 0.0), (300 + k) * MS, 300 * MS) for k in range(1, without)]
    guard.saw(DeviceSample((299 + without) * MS, position=(0.0, 0.0, 0.0)))
    x = np.array([c[0] for c in [*old, *run(guard, 200, (after, 0.0, 0.0), 300 + without)]])
    assert x[0] == 1.0 and x[-1] == after
    assert max(abs(np.diff(x))) <= (1.0 + abs(1.0 - after)) * 1e-3 / FALL + abs(after) * 1e-3 / WIDE.ramp + 1e-12


def test_a_late_cycle_falls_as_far_as_time_has_passed():
    guard = Guard(WIDE)
    run(guard, 300)
    assert guard.apply((1.0, 0.0, 0.0), 330 * MS, 300 * MS) == (0.0, 0.0, 0.0)
    assert FALL < 0.020


def test_too_fast_a_grip_gets_no_force():
    guard = Guard(WIDE)
    run(guard, 300)
    sent = run(
        guard, 40, start=301, sample=lambda now: DeviceSample(now, position=(1.5e-9 * (now - 300 * MS), 0.0, 0.0))
    )
    assert guard.why(340 * MS, 340 * MS) == "too fast" and sent[-1] == (0.0, 0.0, 0.0)


def test_the_dead_man_button_has_to_be_held():
    guard = Guard(WIDE, deadman=0b111)
    assert not any(c[0] for c in run(guard, 200))
    held = run(guard, 200, start=201, sample=lambda now: DeviceSample(now, position=(0.0,) * 3, buttons=0b010))
    assert held[-1][0] == 1.0
    assert run(guard, 30, start=401)[-1] == (0.0, 0.0, 0.0)


def test_two_missing_answers_in_a_row_are_forgiven_and_three_are_not():
    guard = Guard(WIDE)
    for now in (MS, 2 * MS):
        guard.saw(None)
        guard.saw(None)
        guard.saw(DeviceSample(now, position=(0.0,) * 3))
        guard.saw(None)
        guard.saw(None)
        assert guard.why(now, now) == ""
    guard.saw(None)
    assert guard.why(2 * MS, 2 * MS) == "answers are missing"


def test_a_command_may_be_nine_milliseconds_old_and_not_eleven():
    guard = Guard(WIDE)
    guard.saw(DeviceSample(20 * MS, position=(0.0,) * 3))
    assert guard.why(20 * MS, 11 * MS) == "" and guard.why(20 * MS, 9 * MS) == "the command is old"


def test_a_sensor_that_takes_no_command_is_sent_none():
    guard = Guard(Limits(0.0, 0.0, math.inf, ramp=0.0))
    guard.saw(DeviceSample(MS, wrench=(0.0,) * 6))
    assert guard.apply((), MS, MS) == ()


def test_when_homing_is_lost_the_force_falls_evenly_though_no_power_is_known():
    guard = Guard(Limits(command=4.0, power=0.01, speed=math.inf, ramp=0.0))
    guard.saw(DeviceSample(MS, position=(0.0,) * 3))
    assert guard.apply((4.0, 0.0, 0.0), MS, MS)[0] == 4.0
    guard.saw(DeviceSample(2 * MS, homed=False))
    falling = [guard.apply((4.0, 0.0, 0.0), k * MS, k * MS)[0] for k in range(2, 20)]
    assert falling == approx([max(0.0, 4.0 * (1.0 - (k - 1) * 1e-3 / FALL)) for k in range(2, 20)], abs=1e-12)


def test_a_force_comes_in_over_the_ramp_from_the_first_command_on():
    guard = Guard(WIDE)
    guard.saw(DeviceSample(MS, position=(0.0,) * 3))
    assert guard.apply((1.0, 0.0, 0.0), MS, MS) == (0.0, 0.0, 0.0)


def test_torques_are_limited_each_for_itself_and_a_force_by_its_length():
    full = {}
    for each in (True, False):
        guard = Guard(Limits(command=0.4, power=math.inf, speed=math.inf, each=each, ramp=0.0))
        guard.saw(DeviceSample(MS, joints=(0.0,) * 3))
        full[each] = guard.apply((4.0, 4.0, -4.0), MS, MS)
    assert full[True] == approx((0.4, 0.4, -0.4)) and np.linalg.norm(full[False]) == approx(0.4)


def test_the_power_of_torques_is_that_at_the_joints():
    guard = Guard(Limits(command=10.0, power=0.5, speed=math.inf, ramp=0.0))
    for k in range(1, 20):
        guard.saw(DeviceSample(k * MS, joints=(2e-3 * k, 0.0, 0.0), position=(0.0, 1e-6 * k, 0.0)))  # 2 rad/s
    assert guard.apply((4.0, 0.0, 0.0), 19 * MS, 19 * MS)[0] == approx(0.25)


def test_a_sample_that_is_no_newer_than_the_last_changes_nothing():
    guard = Guard(WIDE)
    for k, x in ((1, 0.0), (2, 1e-4), (3, 2e-4), (2, 0.5), (3, 0.5)):
        guard.saw(DeviceSample(k * MS, position=(x, 0.0, 0.0)))
    assert guard.rates()[1] == approx((0.1, 0.0, 0.0))


def test_without_a_sample_there_are_no_rates():
    guard = Guard(WIDE)
    assert guard.rates() == ((), ())
    guard.saw(DeviceSample(MS, position=(0.0,) * 3))
    assert guard.rates() == ((), ())


def test_rates_are_those_of_the_last_eight_intervals():
    guard = Guard(WIDE)
    for k in range(1, 20):
        guard.saw(DeviceSample(k * MS, position=(1.0 if k < 11 else 1.0 + 1e-3 * (k - 11), 0.0, 0.0)))
    assert guard.rates()[1] == approx((1.0, 0.0, 0.0))
    guard.saw(DeviceSample(20 * MS, position=(1.008, 0.0, 0.0)))
    assert guard.rates()[1] == approx((7 / 8, 0.0, 0.0))


def test_another_button_is_no_dead_man_button():
    guard = Guard(WIDE, deadman=0b110)
    sent = run(guard, 200, sample=lambda now: DeviceSample(now, position=(0.0,) * 3, buttons=0b1001))
    assert not any(c[0] for c in sent) and guard.why(200 * MS, 200 * MS) == "the dead-man button is not held"


def test_a_device_without_an_answer_for_long_gets_no_force_in_however_few_cycles():
    guard = Guard(WIDE)
    run(guard, 300)
    guard.saw(None)
    late = 300 * MS + round(SILENT * 1e9)
    assert guard.why(late, late) == "" and guard.why(late + 1, late + 1) == "answers are missing"


@given(st.tuples(NUMBER, NUMBER, NUMBER), st.booleans())
@example((0.0, 1.3e308, 1.3e308), False)
def test_no_command_passes_the_limit_and_its_direction_stays(command, each):
    limits = Limits(command=0.4, power=math.inf, speed=math.inf, each=each, ramp=0.0)
    guard = Guard(limits)
    guard.saw(DeviceSample(1, joints=(0.0,) * 3))
    sent = np.array(guard.apply(command, 2, 2))
    assert np.all(np.isfinite(sent))
    size = np.abs(sent).max() if each else np.linalg.norm(sent)
    assert size <= 0.4 * (1 + 1e-12)
    if np.all(np.isfinite(command)) and np.abs(command).max() > 1e-100:
        asked = np.array(command) / np.abs(command).max()
        asked /= np.linalg.norm(asked)
        assert sent / max(np.linalg.norm(sent), 1e-300) == approx(asked, abs=1e-9)
    elif not np.all(np.isfinite(command)):
        assert not sent.any()


def test_power_given_to_the_hand_is_limited_and_power_taken_is_not():
    guard = Guard(Limits(command=10.0, power=0.5, speed=math.inf, ramp=0.0))
    for k in range(1, 20):
        guard.saw(DeviceSample(k * MS, position=(1e-3 * k, 0.0, 0.0)))  # 1 m/s along x
    assert guard.apply((4.0, 0.0, 0.0), 20 * MS, 20 * MS)[0] == approx(0.5)
    assert guard.apply((-4.0, 0.0, 0.0), 20 * MS, 20 * MS)[0] == approx(-4.0)
    assert guard.apply((0.0, 4.0, 0.0), 20 * MS, 20 * MS)[1] == approx(4.0)


@given(st.floats(-20.0, 20.0), st.floats(-2.0, 2.0))
@example(0.6, 1.0)
def test_no_more_than_the_power_limit_is_given_and_what_is_below_passes(force, speed):
    guard = Guard(Limits(command=20.0, power=0.5, speed=math.inf, ramp=0.0))
    for k in range(1, 20):
        guard.saw(DeviceSample(k * MS, position=(1e-3 * k * speed, 0.0, 0.0)))
    sent, _, _ = guard.apply((force, 0.0, 0.0), 20 * MS, 20 * MS)
    asked = force * speed
    assert sent * speed == approx(min(asked, 0.5), abs=1e-9)
    assert sent == approx(force) or asked > 0.5


def test_every_device_has_finite_limits():
    for name, limits in LIMITS.items():
        assert math.isfinite(limits.command) and limits.command >= 0.0, name
        assert math.isfinite(limits.power) and limits.ramp > 0.0, name


def test_a_sample_is_carried_on_at_its_rate_and_not_for_long():
    guard = Guard(WIDE)
    for k in range(1, 12):
        guard.saw(DeviceSample(k * MS, joints=(1e-3 * k,), position=(0.0, 2e-3 * k, 0.0)))
    last = DeviceSample(11 * MS, joints=(0.011,), position=(0.0, 0.022, 0.0))
    soon = ahead(last, guard.rates(), 13 * MS)
    assert soon.joints == approx((0.013,)) and soon.position == approx((0.0, 0.026, 0.0))
    assert ahead(last, guard.rates(), 900 * MS).joints == approx((0.011 + 1e3 * 1e-3 * HORIZON,))
    assert ahead(last, ((), ()), 13 * MS) == last
