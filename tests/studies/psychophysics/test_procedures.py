"""Staircases, constant stimuli, and the order of trials."""

from collections import Counter

import numpy as np
import pytest
from simulated_sessions import CONSTANT, HEAD, STAIRCASE

from palpate.physics.errors import ArgumentError
from palpate.studies.psychophysics.file import load
from palpate.studies.psychophysics.procedures import Constant, Staircase
from palpate.studies.psychophysics.schedule import schedule
from palpate.studies.psychophysics.stimuli import Stimuli


def staircase(**changes):
    given = {"start": 10.0, "steps": [2.0], "ratio": False, "rule": "1-down-1-up", "reversals": 0, "trials": 0}
    return Staircase(**{**given, **changes})


def walk(one, answers):
    levels = []
    for hit in answers:
        levels.append(one.level)
        one.take(bool(int(hit)))
    return [*levels, one.level]


def test_two_down_one_up_goes_down_after_two_hits_in_a_row_and_up_after_a_miss():
    assert walk(staircase(rule="2-down-1-up"), "11101011") == [10, 10, 8, 8, 10, 10, 12, 12, 10]


def test_steps_shrink_with_each_reversal_and_the_number_of_reversals_ends_the_procedure():
    one = staircase(steps=[4.0, 2.0, 1.0], reversals=3)
    assert walk(one, "1010") == [10, 6, 8, 7, None]
    assert one.reversals == [6, 8, 7]


def test_ratios_are_taken_of_the_distance_from_the_reference_to_either_side():
    assert walk(staircase(start=14.0, origin=10.0, ratio=True), "110") == [14, 12, 11, 12]
    assert walk(staircase(start=6.0, origin=10.0, ratio=True), "110") == [6, 8, 9, 8]


def test_a_step_over_the_reference_or_a_limit_is_not_taken():
    assert walk(staircase(start=13.0, origin=10.0), "11") == [13, 11, 11]
    assert walk(staircase(start=10.0, least=9.0, greatest=12.0), "100") == [10, 10, 12, 12]


def test_a_hit_raises_the_level_where_higher_is_harder():
    assert walk(staircase(sign=-1), "1101") == [10, 12, 14, 12, 14]


@pytest.mark.parametrize("rule", ["2down1up", "0-down-1-up", ""])
def test_another_rule_is_refused(rule):
    with pytest.raises(ArgumentError, match="expected such as 2-down-1-up"):
        staircase(rule=rule)


@pytest.mark.parametrize("down", [1, 2, 3])
def test_n_down_one_up_converges_to_the_level_with_even_odds_of_n_hits_in_a_row(down):
    """Levitt's rule: ψ^N = 1/2; here ψ falls along a straight line from 1 at 20 to 0 at 0."""
    one, random, levels = (
        staircase(rule=f"{down}-down-1-up", steps=[0.25], trials=20_000),
        np.random.default_rng(down),
        [],
    )
    while one.level is not None:
        levels.append(one.level)
        one.take(bool(random.random() < one.level / 20.0))
    assert np.mean(levels[1000:]) / 20.0 == pytest.approx(0.5 ** (1.0 / down), abs=0.02)


def test_constant_stimuli_are_repeated_in_a_random_order():
    one, seen = Constant([1.0, 2.0, 3.0], 5, np.random.default_rng(0)), []
    while one.level is not None:
        seen.append(one.level)
        one.take(True)
    assert Counter(seen) == {1.0: 5, 2.0: 5, 3.0: 5} and seen != sorted(seen)


def trials(stimuli, participant="01", session=1, hit=lambda trial: True):
    order, found = schedule(stimuli, participant, session), []
    trial = next(order)
    while True:
        found.append(trial)
        try:
            trial = order.send(hit(trial))
        except StopIteration:
            return found


def stimuli(write, text):
    file = write("one.yaml", text)
    return Stimuli(*load(file), file)


def test_the_same_answers_give_the_same_trials_and_another_session_others(write):
    given = stimuli(write, STAIRCASE)
    assert trials(given) == trials(given)
    assert trials(given) != trials(given, session=2) and trials(given) != trials(given, "02")
    assert {trial.track for trial in trials(given)} == {1, 2} and len(trials(given)) == 120


def test_the_comparison_comes_first_as_often_as_second(write):
    found = Counter(trial.interval for trial in trials(stimuli(write, CONSTANT)))
    assert abs(found[1] - found[2]) < 3.3 * np.sqrt(140) and sum(found.values()) == 140


def test_blocks_are_in_the_given_or_a_random_order_with_catch_trials_between(write):
    blocks = "\n".join(f"  b{n}: {{procedure: constant, levels: [4e3], repeats: 30, catch: 0.4}}" for n in range(5))
    text = f"{HEAD}\nreference: 3e3\nresponse: yes-no\nblocks:\n{blocks}\n"
    given = trials(stimuli(write, text))
    assert list(dict.fromkeys(trial.block for trial in given)) == ["b0", "b1", "b2", "b3", "b4"]
    signals = [trial for trial in given if trial.level is not None]
    assert len(signals) == 150 and 60 < len(given) - len(signals) < 145
    random = stimuli(write, text + "order: random\n")
    assert len({tuple(dict.fromkeys(t.block for t in trials(random, session=n))) for n in range(1, 9)}) > 4
