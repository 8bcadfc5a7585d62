"""The guard: limits, gains and the conditions that remove the force."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pytest import approx

from palpate.drivers.guard import FALL, MISSED, SILENT, STALE, DeviceSample, Guard, ahead
from palpate.drivers.limits import LIMITS, Limits

MS = 1_000_000
WIDE = Limits(command=4.0, power=100.0, speed=1.0, box=((-1.0,) * 3, (1.0,) * 3), ramp=0.1)
NUMBER = st.floats(allow_nan=True, allow_infinity=True)


def run(guard, count, command=(1.0, 0.0, 0.0), start=1, sample=None, age=0):
    """Run one cycle per millisecond; returns the command of each."""
    sent = []
    for k in range(start, start + count):
        now = k * MS
        sent.append(guard.apply(command, now, now - age))
        given = DeviceSample(now, position=(0.0, 0.0, 0.0)) if sample is None else sample(now)
        guard.note_answer(given)
    return sent


def test_the_force_ramps_up_within_the_ramp_time():
    sent = run(Guard(WIDE), 200)
    x = [c[0] for c in sent]
    assert x[0] == 0.0 and x[-1] == 1.0
    assert np.all(np.diff(x) >= 0.0) and max(np.diff(x)) == approx(0.01, rel=1e-6)
    assert 95 <= sum(v < 1.0 for v in x) <= 105


def test_the_first_command_begins_the_ramp_at_any_time_of_the_clock():
    """A monotonic clock is far from zero at the start; that time is no time of the ramp."""
    guard, begin = Guard(WIDE), 10**15
    guard.note_answer(DeviceSample(begin, position=(0.0,) * 3))
    sent = [guard.apply((1.0, 0.0, 0.0), begin + k * MS, begin + k * MS)[0] for k in range(3)]
    assert sent == approx([0.0, 0.01, 0.02])


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("answers are missing", {"sample": lambda now: None}),
        ("the command is old", {"age": round(STALE * 1e9) + 1}),
        ("not homed", {"sample": lambda now: DeviceSample(now, homed=False)}),
        ("outside its box", {"sample": lambda now: DeviceSample(now, position=(0.0, 0.0, 2.0))}),
    ],
)
def test_each_condition_removes_the_force_within_20_ms(name, spoil):
    guard = Guard(WIDE)
    run(guard, 300)
    assert guard.gain == 1.0
    sent = run(guard, 40, start=301, **spoil)
    assert guard.why(340 * MS, 340 * MS - spoil.get("age", 0)) == name
    first = next(i for i, c in enumerate(sent) if c[0] < 1.0)
    none = next(i for i, c in enumerate(sent) if c[0] == 0.0)
    assert none - first <= 20 and first <= MISSED + 1
    assert all(c == (0.0, 0.0, 0.0) for c in sent[none:])
    assert run(guard, 150, start=500)[-1] == (1.0, 0.0, 0.0), "it ramps up again after the condition"


@pytest.mark.parametrize("without", range(12, 30, 3))
@pytest.mark.parametrize("after", [0.0, -1.0, 3.0])
def test_the_command_never_jumps_around_an_outage(without, after):
    """Also if another command arrives while the last one is falling to 0."""
    guard = Guard(WIDE)
    run(guard, 300)
    old = [guard.apply((1.0, 0.0, 0.0), (300 + k) * MS, 300 * MS) for k in range(1, without)]
    guard.note_answer(DeviceSample((299 + without) * MS, position=(0.0, 0.0, 0.0)))
    x = np.array([c[0] for c in [*old, *run(guard, 200, (after, 0.0, 0.0), 300 + without)]])
    assert x[0] == 1.0 and x[-1] == after
    assert max(abs(np.diff(x))) <= (1.0 + abs(1.0 - after)) * 1e-3 / FALL + abs(after) * 1e-3 / WIDE.ramp + 1e-12


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("side", "outward"), [(0, -1.0), (1, 1.0)], ids=["low", "high"])
@pytest.mark.parametrize("limits", [WIDE, LIMITS["falcon"]], ids=["wide", "falcon"])
def test_each_of_the_six_sides_of_the_box_removes_the_force(limits, side, outward, axis):
    guard, middle = Guard(limits), [0.5 * (low + high) for low, high in zip(*limits.box, strict=True)]
    for away, reason in ((-1e-6, ""), (1e-6, "outside its box")):
        place = middle.copy()
        place[axis] = limits.box[side][axis] + outward * away
        guard.reset()
        guard.note_answer(DeviceSample(MS, position=tuple(place)))
        assert guard.why(MS, MS) == reason


def test_the_fall_after_a_late_cycle_follows_the_elapsed_time():
    guard = Guard(WIDE)
    run(guard, 300)
    assert guard.apply((1.0, 0.0, 0.0), 330 * MS, 300 * MS) == (0.0, 0.0, 0.0)
    assert FALL < 0.020


@pytest.mark.parametrize(("before", "gain"), [(20, 0.2), (300, 1.0)], ids=["during the ramp", "after it"])
@pytest.mark.parametrize("command", [1.0, -1.0])
def test_after_a_pause_of_its_thread_the_command_neither_jumps_nor_is_full_at_once(before, gain, command):
    """The device has kept its command; its first answer after the pause is new, and the graph has gone on."""
    guard = Guard(WIDE)
    last = run(guard, before)[-1][0]
    assert last == approx(gain, abs=0.02)
    end = before + 600
    guard.note_answer(DeviceSample(end * MS, position=(0.0, 0.0, 0.0)))
    x = np.array([last, *(c[0] for c in run(guard, 200, (command, 0.0, 0.0), end))])
    step = abs(last - gain * command) * 1e-3 / FALL + 1e-3 / WIDE.ramp + 1e-12
    assert max(abs(np.diff(x))) <= step + 0.02 and x[-1] == command


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_fades_and_does_not_jump(wrong):
    guard = Guard(WIDE)
    run(guard, 300)
    short = [c[0] for c in [*run(guard, 2, (wrong, 0.0, 0.0), 301), *run(guard, 200, start=303)]]
    assert max(abs(np.diff([1.0, *short]))) <= 1e-3 / FALL + 1e-3 / WIDE.ramp + 1e-12 and short[-1] == 1.0
    assert run(guard, 20, (wrong, 0.0, 0.0), 510)[-1] == (0.0, 0.0, 0.0)


def test_a_grip_that_is_too_fast_gets_no_force():
    guard = Guard(WIDE)
    run(guard, 300)
    sent = run(
        guard, 40, start=301, sample=lambda now: DeviceSample(now, position=(1.5e-9 * (now - 300 * MS), 0.0, 0.0))
    )
    assert guard.why(340 * MS, 340 * MS) == "too fast" and sent[-1] == (0.0, 0.0, 0.0)


def test_the_force_requires_the_dead_man_button():
    guard = Guard(WIDE, deadman=0b111)
    assert not any(c[0] for c in run(guard, 200))
    held = run(guard, 200, start=201, sample=lambda now: DeviceSample(now, position=(0.0,) * 3, buttons=0b010))
    assert held[-1][0] == 1.0
    assert run(guard, 30, start=401)[-1] == (0.0, 0.0, 0.0)


def test_three_missing_answers_in_a_row_remove_the_force_and_two_do_not():
    guard = Guard(WIDE)
    for now in (MS, 2 * MS):
        guard.note_answer(None)
        guard.note_answer(None)
        guard.note_answer(DeviceSample(now, position=(0.0,) * 3))
        guard.note_answer(None)
        guard.note_answer(None)
        assert guard.why(now, now) == ""
    guard.note_answer(None)
    assert guard.why(2 * MS, 2 * MS) == "answers are missing"


def test_a_command_is_valid_after_9_ms_and_stale_after_11_ms():
    guard = Guard(WIDE)
    guard.note_answer(DeviceSample(20 * MS, position=(0.0,) * 3))
    assert guard.why(20 * MS, 11 * MS) == "" and guard.why(20 * MS, 9 * MS) == "the command is old"


def test_a_sensor_without_commands_gets_none():
    guard = Guard(Limits(0.0, 0.0, math.inf, ramp=0.0))
    guard.note_answer(DeviceSample(MS, wrench=(0.0,) * 6))
    assert guard.apply((), MS, MS) == ()


def test_when_homing_is_lost_the_force_falls_linearly_without_a_known_power():
    guard = Guard(Limits(command=4.0, power=0.01, speed=math.inf, ramp=0.0))
    guard.note_answer(DeviceSample(MS, position=(0.0,) * 3))
    assert guard.apply((4.0, 0.0, 0.0), MS, MS)[0] == 4.0
    guard.note_answer(DeviceSample(2 * MS, homed=False))
    falling = [guard.apply((4.0, 0.0, 0.0), k * MS, k * MS)[0] for k in range(2, 20)]
    assert falling == approx([max(0.0, 4.0 * (1.0 - (k - 1) * 1e-3 / FALL)) for k in range(2, 20)], abs=1e-12)


def test_the_ramp_starts_with_the_first_command():
    guard = Guard(WIDE)
    guard.note_answer(DeviceSample(MS, position=(0.0,) * 3))
    assert guard.apply((1.0, 0.0, 0.0), MS, MS) == (0.0, 0.0, 0.0)


def test_torques_are_limited_one_by_one_and_a_force_by_its_length():
    full = {}
    for each in (True, False):
        guard = Guard(Limits(command=0.4, power=math.inf, speed=math.inf, each=each, ramp=0.0))
        guard.note_answer(DeviceSample(MS, joints=(0.0,) * 3))
        full[each] = guard.apply((4.0, 4.0, -4.0), MS, MS)
    assert full[True] == approx((0.4, 0.4, -0.4)) and np.linalg.norm(full[False]) == approx(0.4)


def test_the_power_of_torques_is_computed_at_the_joints():
    guard = Guard(Limits(command=10.0, power=0.5, speed=math.inf, ramp=0.0))
    for k in range(1, 20):
        guard.note_answer(DeviceSample(k * MS, joints=(2e-3 * k, 0.0, 0.0), position=(0.0, 1e-6 * k, 0.0)))  # 2 rad/s
    assert guard.apply((4.0, 0.0, 0.0), 19 * MS, 19 * MS)[0] == approx(0.25)


def test_a_sample_with_an_old_time_is_ignored():
    guard = Guard(WIDE)
    for k, x in ((1, 0.0), (2, 1e-4), (3, 2e-4), (2, 0.5), (3, 0.5)):
        guard.note_answer(DeviceSample(k * MS, position=(x, 0.0, 0.0)))
    assert guard.rates()[1] == approx((0.1, 0.0, 0.0))


def test_rates_are_empty_without_a_sample():
    guard = Guard(WIDE)
    assert guard.rates() == ((), ())
    guard.note_answer(DeviceSample(MS, position=(0.0,) * 3))
    assert guard.rates() == ((), ())


def test_rates_are_averaged_over_the_last_eight_intervals():
    guard = Guard(WIDE)
    for k in range(1, 20):
        guard.note_answer(DeviceSample(k * MS, position=(1.0 if k < 11 else 1.0 + 1e-3 * (k - 11), 0.0, 0.0)))
    assert guard.rates()[1] == approx((1.0, 0.0, 0.0))
    guard.note_answer(DeviceSample(20 * MS, position=(1.008, 0.0, 0.0)))
    assert guard.rates()[1] == approx((7 / 8, 0.0, 0.0))


def test_another_button_does_not_act_as_the_dead_man_button():
    guard = Guard(WIDE, deadman=0b110)
    sent = run(guard, 200, sample=lambda now: DeviceSample(now, position=(0.0,) * 3, buttons=0b1001))
    assert not any(c[0] for c in sent) and guard.why(200 * MS, 200 * MS) == "the dead-man button is not held"


def test_a_long_silence_removes_the_force_in_any_number_of_cycles():
    guard = Guard(WIDE)
    run(guard, 300)
    guard.note_answer(None)
    late = 300 * MS + round(SILENT * 1e9)
    assert guard.why(late, late) == "" and guard.why(late + 1, late + 1) == "answers are missing"


@given(st.tuples(NUMBER, NUMBER, NUMBER), st.booleans())
@example((0.0, 1.3e308, 1.3e308), False)
def test_commands_are_limited_and_keep_their_direction(command, each):
    limits = Limits(command=0.4, power=math.inf, speed=math.inf, each=each, ramp=0.0)
    guard = Guard(limits)
    guard.note_answer(DeviceSample(1, joints=(0.0,) * 3))
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


def test_only_the_power_given_to_the_hand_is_limited():
    guard = Guard(Limits(command=10.0, power=0.5, speed=math.inf, ramp=0.0))
    for k in range(1, 20):
        guard.note_answer(DeviceSample(k * MS, position=(1e-3 * k, 0.0, 0.0)))  # 1 m/s along x
    assert guard.apply((4.0, 0.0, 0.0), 20 * MS, 20 * MS)[0] == approx(0.5)
    assert guard.apply((-4.0, 0.0, 0.0), 20 * MS, 20 * MS)[0] == approx(-4.0)
    assert guard.apply((0.0, 4.0, 0.0), 20 * MS, 20 * MS)[1] == approx(4.0)


@given(st.floats(-20.0, 20.0), st.floats(-2.0, 2.0))
@example(0.6, 1.0)
def test_the_power_limit_leaves_smaller_commands_unchanged(force, speed):
    guard = Guard(Limits(command=20.0, power=0.5, speed=math.inf, ramp=0.0))
    for k in range(1, 20):
        guard.note_answer(DeviceSample(k * MS, position=(1e-3 * k * speed, 0.0, 0.0)))
    sent, _, _ = guard.apply((force, 0.0, 0.0), 20 * MS, 20 * MS)
    asked = force * speed
    assert sent * speed == approx(min(asked, 0.5), abs=1e-9)
    assert sent == approx(force) or asked > 0.5


def test_every_device_has_finite_limits():
    for name, limits in LIMITS.items():
        assert math.isfinite(limits.command) and limits.command >= 0.0, name
        assert math.isfinite(limits.power) and limits.ramp > 0.0, name


def test_a_sample_is_extrapolated_for_a_limited_time():
    guard = Guard(WIDE)
    for k in range(1, 12):
        guard.note_answer(DeviceSample(k * MS, joints=(1e-3 * k,), position=(0.0, 2e-3 * k, 0.0)))
    last = DeviceSample(11 * MS, joints=(0.011,), position=(0.0, 0.022, 0.0))
    soon = ahead(last, guard.rates(), 13 * MS)
    assert soon.joints == approx((0.013,)) and soon.position == approx((0.0, 0.026, 0.0))
    assert ahead(last, guard.rates(), 900 * MS).joints == approx((0.016,)), "1 rad/s for 5 ms"
    assert ahead(last, guard.rates(), 900 * MS).position == approx((0.0, 0.032, 0.0)), "2 m/s for 5 ms"
    assert ahead(last, ((), ()), 13 * MS) == last
