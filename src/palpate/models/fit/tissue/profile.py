"""Intervals of the parameters of a fit by profile likelihoods.

The unknowns x whose sum of squares S(x) does not exceed a level form a region, and the interval of a parameter is the
projection of this region. The profile of the parameter, the least S with this parameter fixed, is followed from the
best minimum to where it reaches the level; then from all other minima within the level, and from the ends at which
other parameters reached a limit of the search. The last are needed where a parameter at its limit leaves another one
undetermined: the time of a Prony term whose share may be 0 (R. B. Davies, Biometrika 64 (1977) 247-254).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.optimize import brentq

from palpate.models.fit.tissue.rigs import Parameter

ENDS = 1e-3  # [1] Accuracy of the ends of a profile, over half the width of the linear interval
FARTHER = 0.1  # [1] Least extension of a profile that another start must give, over the same width
DOUBLINGS = 14  # Most steps that bracket an end, each twice as long as the one before

Minimum = tuple[np.ndarray, float]
"""Unknowns in search coordinates and their sum of squares."""


@dataclass
class Interval:
    """95 % interval of a parameter: the widest of the linear interval, the profile likelihood interval (nan: no limit
    on that side) and the interval from the scatter between presses."""

    value: float
    low: float
    high: float
    profile: tuple[float, float] = (math.nan, math.nan)
    curve: list[tuple[float, float]] = field(default_factory=list)
    presses: list[float] = field(default_factory=list)


class Problem(Protocol):
    """What the profiles need of `estimate.Problem`."""

    parameters: tuple[Parameter, ...]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]: ...
    def solve(self, x: np.ndarray, fixed: int = -1) -> Minimum: ...


def linear_interval(problem: Problem, x: np.ndarray, i: int, reach: float) -> Interval:
    """The interval of parameter i at half the width `reach` in search coordinates, within the bounds."""
    p, (low, high) = problem.parameters[i], problem.bounds
    ends = [min(max(float(x[i]) + side * reach, low[i]), high[i]) for side in (-1, 1)]
    return Interval(p.value(float(x[i])), p.value(ends[0]), p.value(ends[1]))


def include_profiles(
    problem: Problem, minima: Sequence[Minimum], toward: np.ndarray, levels: np.ndarray, intervals: Sequence[Interval]
) -> None:
    """Widen the linear intervals of the parameters to those of their profiles.

    toward  (unknowns, parameters) change of all unknowns from the best minimum to the end of each linear interval
    levels  (unknowns,) of the squares
    """
    least = minima[0][1]
    profiles = [
        Profile(problem, i, least, float(levels[i]), max(float(toward[i, i]), 1e-6)) for i in range(len(intervals))
    ]
    for i, profile in enumerate(profiles):
        profile.follow(minima[0], toward[:, i] / max(float(toward[i, i]), 1e-300))
    limits = [(k, each) for k, profile in enumerate(profiles) for each in profile.limits]
    for i, (profile, out) in enumerate(zip(profiles, intervals, strict=True)):
        for start in (*minima[1:], *(each for k, each in limits if k != i)):
            if start[1] < profile.level:
                profile.follow(start, np.eye(len(start[0]))[i])
        p = problem.parameters[i]
        ends = [math.nan if math.isnan(v) else p.value(v) for v in profile.ends]
        out.profile = (ends[0], ends[1])
        out.low = min(out.low, p.low if math.isnan(ends[0]) else ends[0])
        out.high = max(out.high, p.high if math.isnan(ends[1]) else ends[1])
        out.curve = sorted((p.value(v), (c - least) / max(profile.level - least, 1e-300)) for v, c in profile.points)


class Profile:
    """The profile of unknown i: the least sum of squares with x_i fixed.

    ends    where it reaches `level`, which exceeds the `least` sum of squares; nan: it does not within the bounds
    points  (value, sum of squares) of the profile
    limits  all unknowns where it ends at a bound
    step    half the width of the linear interval
    """

    def __init__(self, problem: Problem, i: int, least: float, level: float, step: float) -> None:
        self.problem, self.i, self.least, self.level, self.step = problem, i, least, level, step
        self.ends: list[float] = []
        self.points: list[tuple[float, float]] = []
        self.limits: list[Minimum] = []

    def follow(self, minimum: Minimum, along: np.ndarray) -> None:
        """Find the ends from a minimum, or extend those that were found from another one.

        along  [1] change of all unknowns with unknown i along the profile, near the minimum
        """
        self.points.append((float(minimum[0][self.i]), minimum[1]))
        known = self.ends or [-math.inf, math.inf]
        self.ends = [self._end(side, minimum, along, end) for side, end in zip((-1.0, 1.0), known, strict=True)]

    def _end(self, side: float, minimum: Minimum, along: np.ndarray, known: float) -> float:
        """The end on one side; `known`: that from another minimum, nan at a bound, infinite: none was sought."""
        if math.isnan(known):
            return known
        (x, squares), i, (low, high) = minimum, self.i, self.problem.bounds
        bound = float(low[i] if side < 0 else high[i])
        inner = float(x[i])
        inside, excess = [x], {inner: self._above(squares)}

        def above(value: float) -> float:
            """Standard errors by which the profile at a value exceeds the level. Its search begins from the nearest
            point within the level: a point beyond it may lie in the valley of another minimum."""
            if value not in excess:
                near = min(inside, key=lambda y: abs(float(y[i]) - value))
                trial = np.clip(near + (value - near[i]) * along, low, high)
                trial[i] = value
                at, found = self.problem.solve(trial, i)
                self.points.append((value, found))
                excess[value] = self._above(found)
                inside.extend([at] if excess[value] < 0.0 else [])
            return excess[value]

        if math.isfinite(known) and side * (known - inner) >= 0.0:  # does the region of this minimum reach beyond it?
            inner = known + side * FARTHER * self.step
            if side * (inner - bound) > 0.0:
                inner = bound
            if above(inner) >= 0.0:
                return known
        reach = self.step
        for _ in range(DOUBLINGS):  # bracket the end
            trial = bound if side * (inner + side * reach - bound) >= 0.0 else inner + side * reach
            if above(trial) >= 0.0:
                return float(brentq(above, inner, trial, xtol=ENDS * self.step, rtol=1e-12))
            inner = trial
            if trial == bound:
                self.limits.append((inside[-1], (excess[trial] + self._root) ** 2 + self.least))
                break
            reach *= 2.0
        return math.nan

    @property
    def _root(self) -> float:
        return math.sqrt(self.level - self.least)

    def _above(self, squares: float) -> float:
        return math.sqrt(max(squares - self.least, 0.0)) - self._root
