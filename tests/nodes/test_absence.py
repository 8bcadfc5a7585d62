"""The gains that fade a force out and in: `nodes.base.absence`, step by step."""

import numpy as np
import pytest
from pytest import approx

from palpate.nodes.base.absence import FADE, FADED, FALL, GAIN, GAP, PACE, begin, fade_value, keep_pace, step_gain

DT = 1e-3


def record(form):
    """A record with attributes, of the shapes of a state."""

    def kind(fields):
        return np.dtype((np.record, [(name, *type_of(each)) for name, each in fields.items()]))

    def type_of(each):
        return (kind(each),) if isinstance(each, dict) else ("?",) if each is bool else ("<f8", each)

    return np.zeros(1, kind(form))[0]


def gain(value=1.0, fall=FALL, rise=0.1):
    made = record(GAIN)
    begin(made, fall, rise)
    made.value = value
    return made


def fading(fall=FADE, rise=FADE):
    made = record(FADED)
    begin(made.gain, fall, rise)
    return made


def steps(state, values):
    """The faded values for each value, None: missing."""
    return np.array([fade_value(state, v is not None, v if v is not None else (9.0, 9.0, 9.0), DT) for v in values])


def test_a_gain_begins_at_one_falls_within_its_time_and_rises_within_another():
    made = gain()
    assert made.value == 1.0
    assert [step_gain(made, False, DT) for _ in range(5)] == approx([0.75, 0.5, 0.25, 0.0, 0.0])
    assert [step_gain(made, True, 25 * DT) for _ in range(5)] == approx([0.25, 0.5, 0.75, 1.0, 1.0])
    assert step_gain(gain(0.3, rise=0.0), True, DT) == 1.0
    assert step_gain(gain(0.3, rise=-1.0), True, DT) == 1.0
    assert step_gain(gain(0.5), True, 1e-9) == approx(0.5) and step_gain(gain(0.5), True, 0.02) == approx(0.7)


@pytest.mark.parametrize(("last", "dt", "pause"), [
    (DT, DT, False), (DT, 2.9 * DT, False), (DT, GAP, False), (DT, 1.001 * GAP, True), (0.0, 1.0, False),
    (4e-3, 11.9e-3, False), (4e-3, 12.1e-3, True), (0.02, 0.05, False), (0.02, 0.07, True),
])  # fmt: skip
def test_a_pause_is_a_step_longer_than_the_gap_and_three_times_the_last(last, dt, pause):
    pace = record(PACE)
    keep_pace(pace, last)
    assert keep_pace(pace, dt) == pause
    assert pace.last == dt and pace.usual == (last if 0.0 < last < dt else dt)


def test_the_usual_step_is_the_shorter_of_the_last_two():
    pace = record(PACE)
    assert [(keep_pace(pace, dt), pace.usual)[1] for dt in (2.0, 3.0, 1.0, 5.0, 4.0)] == [2.0, 2.0, 1.0, 1.0, 4.0]


def test_a_value_passes_unchanged_while_it_is_available():
    values = [(0.1, -0.2, 0.3), (1.0, 2.0, 3.0), (0.3, 0.3, 0.1)]
    assert steps(fading(), values).tolist() == [list(each) for each in values]


def test_a_value_that_stops_fades_out_linearly_and_stays_zero():
    out = steps(fading(), [(1.0, -2.0, 4.0)] + [None] * 25)
    share = np.maximum(1.0 - np.arange(26) * DT / FADE, 0.0)
    assert out == approx(np.outer(share, (1.0, -2.0, 4.0)), abs=1e-12)


def test_a_value_that_returns_after_a_long_absence_ramps_up_from_zero():
    out = steps(fading(rise=10 * DT), [(1.0, -2.0, 4.0)] + [None] * 30 + [(2.0, 6.0, -1.0)] * 15)[31:]
    assert out == approx(np.outer(np.minimum(np.arange(1, 16) * 0.1, 1.0), (2.0, 6.0, -1.0)), abs=1e-12)


def test_a_value_that_returns_early_does_not_jump_and_its_difference_fades():
    """After 5 of 20 ms: the gain is 0.75, and the rest 0.75 ((1, 2, 3) - (0, 0, 0)) fades within 20 ms."""
    out = steps(fading(), [(1.0, 2.0, 3.0)] + [None] * 5 + [(0.0, 0.0, 0.0)] * 25)
    rest = 0.75 * np.maximum(1.0 - np.arange(1, 26) * DT / FADE, 0.0)
    assert out[6:] == approx(np.outer(rest, (1.0, 2.0, 3.0)), abs=1e-12)


def test_a_second_absence_keeps_the_rest_of_the_first_and_never_jumps():
    values = [(1.0, 2.0, 3.0)] * 2 + [None] * 5 + [(-1.0, 0.5, 0.0)] * 4 + [None] * 6 + [(0.5, -2.0, 1.0)] * 60
    out = steps(fading(), values)
    assert np.abs(np.diff(out, axis=0)).max() <= 2.5 * 3.0 * DT / FADE
    assert out[-1].tolist() == [0.5, -2.0, 1.0]
    # by hand: gain g and share s in steps of 1/20 after the changes
    first = 0.75 * (np.array([1.0, 2.0, 3.0]) - [-1.0, 0.5, 0.0])
    assert out[7] == approx(0.8 * np.array([-1.0, 0.5, 0.0]) + 0.95 * first)
    before = 0.95 * np.array([-1.0, 0.5, 0.0]) + 0.8 * first  # after 4 steps
    assert out[10] == approx(before)
    assert out[16] == approx(0.65 * np.array([-1.0, 0.5, 0.0]) + 0.5 * first)
    second = 0.65 * (np.array([-1.0, 0.5, 0.0]) - [0.5, -2.0, 1.0]) + 0.5 * first
    assert out[17] == approx(0.7 * np.array([0.5, -2.0, 1.0]) + 0.95 * second)
