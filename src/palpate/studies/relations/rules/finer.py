"""Runs at higher rates, which must approach a limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.studies.organs.score import Score
from palpate.studies.relations.relation import LIGHT, Case, Claim, Relation
from palpate.studies.relations.runs import Trace

SMALLER = 0.7  # [1] by which the change of the force falls when the rate doubles; 0.5 for the first order
SETTLED = 2e-3  # [1] of the peak: changes below it are of rounding, of events between ticks, or of the arm
RATE = 1000.0  # [Hz]


def rate(case: Case, rng: np.random.Generator) -> Claim | None:
    """Two doublings of the rate, without friction, whose sticking is an event."""
    exact = case.but(exact=True, friction="", rate=RATE).run
    runs = tuple(replace(exact, rate=RATE * by) for by in (1, 2, 4))

    def judge(one: Trace, two: Trace, four: Trace) -> Score:
        a, b, c = one.force, two.force[1::2][: len(one.force)], four.force[3::4][: len(one.force)]
        first, second = (float(np.sqrt(np.mean((x - y) ** 2))) for x, y in ((a, b), (b, c)))
        bound = SMALLER * first + SETTLED * max(four.peak, LIGHT)
        return Score(second / bound, len(a) * one.step, second, bound)

    return Claim(runs, judge)


ABOUT = "a doubled rate changes the force less than the doubling before"
RELATIONS = (Relation("rate", ABOUT, f"{SMALLER:g} + {SETTLED:.1%} of the peak", rate, share=0.3),)
