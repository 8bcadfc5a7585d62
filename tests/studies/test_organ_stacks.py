"""The random search of stacks of organs: a random row breaks no invariant, and a planted fault is reported."""

from dataclasses import replace

import pytest

from palpate.studies import organ_stacks
from palpate.studies.neighbours_report import stack_row, text
from palpate.studies.organ_stacks import draw_stack, judge_stack


@pytest.mark.parametrize("number", range(3))
def test_a_random_stack_breaks_no_invariant_and_is_the_same_for_its_number(number):
    verdict = judge_stack(draw_stack(number, seed=3))
    assert verdict.faults == () and verdict.energy <= 1.0 + organ_stacks.GAINED
    assert draw_stack(number, seed=3) == verdict.stack != draw_stack(number, seed=4)


def test_a_free_ball_that_others_turn_by_a_radian_gains_no_energy():
    """With candidates that stayed on both balls it gained 16 times the energy, and they overlapped by 9 mm."""
    verdict = judge_stack(draw_stack(33, seed=5))
    assert verdict.faults == () and verdict.energy <= 1.0 + organ_stacks.GAINED


def test_a_fault_is_reported_with_its_stack(monkeypatch):
    """A wrong start of the momentum: that of a stack whose first organ is slower."""
    stack = next(each for each in map(draw_stack, range(50)) if each.free)
    slow = replace(stack, speed=tuple(0.5 * v for v in stack.speed))
    made = organ_stacks.run_stack(slow)
    monkeypatch.setattr(organ_stacks, "run_stack", lambda *_, **__: made)
    row = stack_row(judge_stack(stack))
    assert row["faults"] == ["momentum lost"] and row["lost"] == pytest.approx(0.5, rel=1e-6)
    report = text({"pairs": [], "stacks": [row]}, 3)
    assert "1 with faults" in report and "momentum lost" in report and stack.words() in report
