"""Weighted least squares of a force law, with confidence intervals that allow for correlated residuals.

The residuals of a press are correlated, because its noise is filtered and no law is exact: `covariance` has the errors
of the unknowns and half the widths of their intervals. The level of a profile likelihood is that at which it has this
width where the law is linear in the unknowns. With several presses, the interval is at least as wide as the scatter
between presses requires. The residuals count as n/tau independent ones in the tests for misfits,
tau = 1 + 2 sum rho_k.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue import noise, relaxing, separable
from palpate.models.fit.tissue.errors import covariance
from palpate.models.fit.tissue.errors.covariance import LEVEL
from palpate.models.fit.tissue.measured import MOST_RISE, Hum, MeasuredPress, Rise
from palpate.models.fit.tissue.profile import Interval, include_profiles, linear_interval
from palpate.models.fit.tissue.residuals import runs
from palpate.models.fit.tissue.rigs import Law, Parameter

STARTS, TOUCH_STARTS = 10, 4  # Starts of a law with shape parameters, and without
INDISTINGUISHABLE = 0.97  # [1] Correlation above which two parameters cannot be distinguished
LEAST_PER_UNKNOWN = 3  # Rows per unknown that a fit needs
STEEPEST = 1e12  # [1] Limit of a derivative of a residual
APART, LIKELY = (
    1e-2,
    3.0,
)  # Least distance of two minima in search coordinates; limit of their squares, over the least [1]
SHORTEST, LONGEST = 0.02, 2.0  # [1] Lengths of a rise before contact, over the approach
STEP = 1e-6  # finite-difference step of a Jacobian, in search coordinates


@dataclass
class Estimate:
    """Result of a fit; lists have one entry per press.

    correlation  of all unknowns in the order of `names`: parameters, touch points, baselines
    condition    condition number of the scaled Jacobian
    effective    (number of independent residuals, number of residuals)
    starts       share of the starts that converged to this minimum
    squares      mean square of the weighted residuals;  runs  see `residuals.runs`
    at, errors   all unknowns in search coordinates, in the order of `names`, and their standard errors
    fitted, pressed  forces [N] (n,) of the fit, and those of its law alone, without baselines
    withheld     whether no interval is given because of misfit: the intervals are then the whole range of the search
    minima       unknowns at the minimum, and at others that are nearly as good
    """

    parameters: tuple[Parameter, ...]
    intervals: dict[str, Interval]
    touches: list[float]
    names: list[str]
    correlation: np.ndarray
    condition: float
    fitted: list[np.ndarray]
    pressed: list[np.ndarray]
    residuals: list[np.ndarray]
    effective: tuple[float, int]
    starts: float
    squares: float
    runs: float
    at: np.ndarray
    errors: np.ndarray
    withheld: bool = False
    minima: list[np.ndarray] = field(default_factory=list)

    def number(self, name: str) -> tuple[float, float]:
        """An unknown in search coordinates and its standard error; (0, 0) if it was not fitted."""
        if name not in self.names:
            return 0.0, 0.0
        return float(self.at[self.names.index(name)]), float(self.errors[self.names.index(name)])

    def is_open(self, p: Parameter) -> bool:
        """Whether the interval of a parameter reaches a limit of the search."""
        at, (low, high) = self.intervals[p.name], (p.to_search(p.low), p.to_search(p.high))
        edge = 1e-6 * (high - low)
        return p.to_search(at.low) <= low + edge or p.to_search(at.high) >= high - edge

    def withhold(self) -> None:
        """Replace the intervals by the whole range of the search."""
        self.withheld = True
        for p in self.parameters:
            self.intervals[p.name].low, self.intervals[p.name].high = p.low, p.high

    @property
    def values(self) -> dict[str, float]:
        return {name: interval.value for name, interval in self.intervals.items()}


class Problem:
    """Residuals and Jacobian of a law with relaxation, over presses, as functions of the unknowns x.

    x contains the parameters (as logarithms where `Parameter.log`), the touch points, the lengths l of the rises before
    contact, exp(min(s, 0)/l) of the indentation s, and the baselines. Each rise ends at the touch point of its press.

    free_touch  whether the touch point of each press is fitted
    relative    weight 1/max(force, 5 % of the peak) instead of 1/peak
    """

    def __init__(self, presses: Sequence[MeasuredPress], law: Law, kind: str, free_touch: bool, relative: bool) -> None:
        self.presses, self.law, self.kind = list(presses), law, kind
        lengths = [relaxing.contact_time(p) for p in presses if p.time is not None]
        if kind != "none" and len(lengths) < len(presses):
            raise SessionError(f"--relaxation {kind}: expected a column of time in every file")
        self.parameters = (*law.parameters, *relaxing.parameters(kind, max(lengths, default=1.0)))
        self.free_touch, self.relative = free_touch, relative
        peaks = [float(np.abs(p.force).max()) for p in presses]
        self.weight = [
            relaxing.measured_rows(kind, p)
            / (np.maximum(np.abs(p.force), 0.05 * peak) if relative else np.full(len(p.force), peak))
            for p, peak in zip(presses, peaks, strict=True)
        ]
        self.baselines: list[tuple[str, int, np.ndarray]] = []
        self.rises: list[tuple[int, int, Rise]] = []  # baseline and press of each
        for i, (press, peak) in enumerate(zip(self.presses, peaks, strict=True)):
            self.baselines.append((f"zero, {press.name}", i, np.full(len(press.force), 0.01 * peak)))
            if press.drifts:
                self.baselines.append((f"drift, {press.name}", i, 0.01 * peak * press.elapsed))
            if press.rise:
                self.baselines.append((f"rise, {press.name}", i, np.full(len(press.force), 0.01 * peak)))
                self.rises.append((len(self.baselines) - 1, i, press.rise))
            if press.hum:
                self.baselines += [(f"{part} of the hum, {press.name}", i, 0.01 * peak * column)
                                   for part, column in _waves(press.hum, press.elapsed)]  # fmt: skip
            if press.bends:
                self.baselines.append((f"bend, {press.name}", i, 0.01 * peak * press.elapsed**2))
        self.names = [p.name for p in self.parameters]
        self.names += [f"touch, {p.name}" for p in presses] if free_touch else []
        self.names += [f"length of the rise, {self.presses[i].name}" for _, i, rise in self.rises if rise.free]
        self.names += [name for name, _, _ in self.baselines]
        self.count = sum(len(p.force) for p in presses)

    @cached_property
    def measured(self) -> np.ndarray:
        """(n,) Weighted measured forces."""
        return np.concatenate([p.force * w for p, w in zip(self.presses, self.weight, strict=True)])

    @cached_property
    def ends(self) -> np.ndarray:
        """First row of each press, and the end of the last one."""
        return np.cumsum([0, *map(len, self.weight)])

    @cached_property
    def _flat(self) -> np.ndarray:
        """(n, k) Weighted baselines, with rises that do not depend on the indentation."""
        columns = np.zeros((self.count, len(self.baselines)))
        for k, (_, i, column) in enumerate(self.baselines):
            columns[self.ends[i] : self.ends[i + 1], k] = column * self.weight[i]
        return columns

    def columns(self, x: np.ndarray) -> np.ndarray:
        """(n, k) Weighted baselines."""
        if not self.rises:
            return self._flat
        columns = self._flat.copy()
        for rows, k, s, _ in self._risen(x):
            columns[rows, k] *= np.exp(s)
        return columns

    def column_slopes(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """(n, unknowns) Derivatives of the baselines of these sizes (k,) by touch points and lengths of rises."""
        slopes = np.zeros((self.count, len(x)))
        touches, lengths = len(self.parameters), self.first_length
        for (rows, k, s, length), (_, i, rise) in zip(self._risen(x), self.rises, strict=True):
            rising = sizes[k] * self._flat[rows, k] * np.exp(s)
            if self.free_touch:
                slopes[rows, touches + i] = np.where(s < 0.0, -self.presses[i].slack / length * rising, 0.0)
            if rise.free:
                slopes[rows, lengths] = -s * rising
                lengths += 1
        return slopes

    def _risen(self, x: np.ndarray) -> list[tuple[slice, int, np.ndarray, float]]:
        """Of each rise: rows, baseline, indentation above the touch point over the length (n,) <= 0, length [m]."""
        touches, at, out = self.touches(x), self.first_length, []
        for k, i, rise in self.rises:
            length = rise.length
            if rise.free:
                length *= math.exp(x[at])
                at += 1
            s = np.minimum(self.presses[i].depth - touches[i], 0.0) / length
            out.append((slice(self.ends[i], self.ends[i + 1]), k, s, length))
        return out

    @property
    def first_length(self) -> int:
        """The first unknown that is the length of a rise, as its logarithm over that of `Rise`."""
        return len(self.parameters) + (len(self.presses) if self.free_touch else 0)

    @cached_property
    def projected(self) -> tuple[separable.Baselines, np.ndarray]:
        """The baselines without rises, and the weighted measured forces (n,) without their part in the space of the
        baselines."""
        baselines = separable.Baselines(self._flat)
        return baselines, baselines.project(self.measured)

    def with_changes(
        self, presses: Sequence[MeasuredPress] | None = None, law: Law | None = None, kind: str | None = None
    ) -> Problem:
        """The problem with other presses, another law or another relaxation."""
        presses = self.presses if presses is None else presses
        return Problem(presses, law or self.law, kind or self.kind, self.free_touch, self.relative)

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest values of the unknowns, in search coordinates."""
        low = [p.to_search(p.low) for p in self.parameters]
        high = [p.to_search(p.high) for p in self.parameters]
        if self.free_touch:  # in units of `MeasuredPress.slack`; with rows before contact anywhere between these rows
            for press in self.presses:
                ends = (np.array([press.depth.min(), press.depth.max()]) - press.touch) / press.slack
                low.append(min(-2.0, float(ends[0])) if press.air else -2.0)
                high.append(max(2.0, 0.99 * float(ends[1])) if press.air else 2.0)
        for rise in (rise for _, _, rise in self.rises if rise.free):
            low.append(math.log(SHORTEST * rise.approach / rise.length))
            high.append(math.log(LONGEST * rise.approach / rise.length))
        limits = [self._limit(name, self.presses[i]) for name, i, _ in self.baselines]
        low += [-limit for limit in limits]  # in percent of the peak
        high += limits
        return np.array(low), np.array(high)

    @staticmethod
    def _limit(name: str, press: MeasuredPress) -> float:
        """Limit of a baseline in percent of the largest force. That of an unknown zero leaves a press on both sides of
        the forces, since the sensor may not be tared. A larger rise before contact is the begin of the law."""
        if name.startswith("rise"):
            return 100.0 * MOST_RISE
        if not name.startswith("zero"):
            return 100.0
        return 10.0 if press.air else 100.0 * (1.0 + float(np.ptp(press.force) / np.abs(press.force).max()))

    def values(self, x: np.ndarray) -> dict[str, float]:
        return {p.name: p.value(v) for p, v in zip(self.parameters, x, strict=False)}

    def touches(self, x: np.ndarray) -> list[float]:
        first = len(self.parameters)
        shifts = x[first : first + len(self.presses)] if self.free_touch else np.zeros(len(self.presses))
        return [p.touch + float(shift) * p.slack for p, shift in zip(self.presses, shifts, strict=True)]

    def law_forces(self, x: np.ndarray) -> list[np.ndarray]:
        """Forces [N] of the law alone, without baselines."""
        values = self.values(x)
        return [
            relaxing.force(self.kind, self.law, values, press, touch)
            for press, touch in zip(self.presses, self.touches(x), strict=True)
        ]

    def forces(self, x: np.ndarray) -> list[np.ndarray]:
        forces = self.law_forces(x)
        shapes = {k: np.exp(s) for _, k, s, _ in self._risen(x)}
        for k, ((_, i, column), size) in enumerate(zip(self.baselines, x[len(x) - len(self.baselines) :], strict=True)):
            forces[i] = forces[i] + size * column * shapes.get(k, 1.0)
        return forces

    def residuals(self, x: np.ndarray) -> np.ndarray:
        parts = [(f - p.force) * w for f, p, w in zip(self.forces(x), self.presses, self.weight, strict=True)]
        out = np.concatenate(parts)
        return np.where(np.isfinite(out), np.clip(out, -1e6, 1e6), 1e6)

    def residual_variance(self, rows: np.ndarray, forces: Sequence[np.ndarray]) -> np.ndarray:
        """Variance (k,) of `rows` (k, n) times the weighted residuals from the steps of the converters."""
        at, out = 0, np.zeros(len(rows))
        for press, force, w in zip(self.presses, forces, self.weight, strict=True):
            if press.step:
                part = rows[:, at : at + len(force)] * w
                dither = noise.dither(press.force - force, force, press.step, press.averaged)
                out += noise.quantised_variance(part, force, press.step, dither, press.averaged)
            at += len(force)
        return out

    def visible_variance(self, J: np.ndarray, forces: Sequence[np.ndarray]) -> float:
        """Expected sum of squares of the weighted residuals, orthogonal to J (n, p), from the steps of the converters:
        all of them, q²/12 in each row, without the part that the fit follows."""
        scaled = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        basis, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
        followed = self.residual_variance(basis[:, sizes > 1e-9 * sizes[0]].T, forces)
        whole = sum(
            press.step**2 / 12.0 * float(w @ w) / press.averaged
            for press, w in zip(self.presses, self.weight, strict=True)
        )
        return max(whole - float(followed.sum()), 0.0)

    def start(self) -> np.ndarray:
        """Initial guesses, with the first parameter scaled so that the forces have the norm of the measured ones."""
        guess = [p.to_search(p.guess) for p in self.parameters]
        x = np.array(guess + [0.0] * (len(self.names) - len(guess)))
        guessed = float(np.linalg.norm(np.concatenate(self.forces(x))))
        measured = float(np.linalg.norm(np.concatenate([p.force for p in self.presses])))
        if self.parameters[0].log and guessed > 0.0 and math.isfinite(guessed):
            x[0] += math.log(measured / guessed)
        return np.clip(x, *self.bounds)

    def other_minima(self, x: np.ndarray) -> list[np.ndarray]:
        """Starts from which the search may find other minima than x."""
        return relaxing.other_orders(self.kind, len(self.law.parameters), x)

    def solve(self, x: np.ndarray, fixed: int = -1) -> tuple[np.ndarray, float]:
        """The minimum that the search reaches from x, and its sum of squares; `fixed` is an unknown that stays."""
        if (found := separable.solve(self, x, fixed)) is not None:
            return found
        low, high = self.bounds
        free = np.arange(len(x)) != fixed

        def whole(part: np.ndarray) -> np.ndarray:
            y = x.copy()
            y[free] = part
            return y

        if not free.any():
            return x, float(np.sum(self.residuals(x) ** 2))
        inside = np.clip(x[free], low[free] + 1e-9, high[free] - 1e-9)
        found = least_squares(
            lambda part: self.residuals(whole(part)), inside, jac=lambda part: self.jacobian(whole(part))[:, free],
            bounds=(low[free], high[free]), x_scale="jac", max_nfev=200,
        )  # fmt: skip
        return whole(found.x), 2.0 * float(found.cost)

    def law_slopes(self, x: np.ndarray, here: Sequence[np.ndarray], free: np.ndarray) -> np.ndarray:
        """(rows, unknowns) Derivatives of the weighted forces of the law, which are `here` at x, by the unknowns of the
        mask `free`: of a scale exact, of the others forward differences. The touch points move together, as each
        belongs to one press."""
        step, count, first = np.where(x + STEP < self.bounds[1], STEP, -STEP), len(self.presses), len(self.parameters)
        slopes, ends = np.zeros((self.count, len(x))), self.ends
        exact = range(0)  # unknowns whose derivatives the relaxation has
        if relaxing.has_slopes(self.kind):
            exact = range(len(self.law.parameters), first)
            if free[exact].any():
                values, touches = self.values(x), self.touches(x)
                for i, (press, touch, w) in enumerate(zip(self.presses, touches, self.weight, strict=True)):
                    found = relaxing.slopes(self.kind, self.law, values, press, touch)
                    slopes[ends[i] : ends[i + 1], exact] = found * w[:, None]
        # the unknown that moves in each press
        moved = [np.full(count, k) for k in range(first) if k not in exact]
        moved += [first + np.arange(count)] if self.free_touch else []
        for each in moved:
            if not free[each].any():
                continue
            if each[0] == 0 and self.law.proportional:
                there, size = [2.0 * force for force in here], np.ones(count)
            else:
                aside, size = x.copy(), step[each]
                aside[each] += size
                there = self.law_forces(aside)
            for i, (k, w) in enumerate(zip(each, self.weight, strict=True)):
                slopes[ends[i] : ends[i + 1], k] = (there[i] - here[i]) / size[i] * w
        return slopes

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """(rows, unknowns) Derivatives of the residuals; those of the baselines are exact."""
        whole, last = self.law_slopes(x, self.law_forces(x), np.ones(len(x), bool)), len(x) - len(self.baselines)
        if self.rises:
            whole += self.column_slopes(x, x[last:])
        whole[:, last:] = self.columns(x)
        # an exponential law can exceed the range of numbers during the search, whose squares must not
        return np.clip(np.nan_to_num(whole, posinf=0.0, neginf=0.0), -STEEPEST, STEEPEST)


def estimate(problem: Problem, profiles: bool = True, begin: Sequence[np.ndarray] = ()) -> Estimate:
    """Fit from several starts, or from those in `begin` alone, with intervals.

    A likelihood may have several minima, as that of Prony terms in a short record. The interval includes the profiles
    from all those that the interval's level does not exclude (`profile`).

    SessionError: fewer than `LEAST_PER_UNKNOWN` rows per unknown.
    """
    count, size = problem.count, len(problem.start())
    if count < LEAST_PER_UNKNOWN * size:
        raise SessionError(
            f"{count} rows remain for {size} unknowns; expected at least {LEAST_PER_UNKNOWN * size}. Rows deeper "
            "than --depth-limit are excluded and, without --relaxation, rows after the deepest one"
        )
    minima, converged = _search_minima(problem, begin)
    x, least = minima[0]
    forces, pressed = problem.forces(x), problem.law_forces(x)
    residuals = [(f - p.force) for f, p in zip(forces, problem.presses, strict=True)]
    weighted = [r * w for r, w in zip(residuals, problem.weight, strict=True)]
    J = problem.jacobian(x)
    # (J'J)^-1 and (J'J)^-1 J' from the singular values of J with columns of unit length
    scale = np.linalg.norm(J, axis=0)
    scale[scale == 0.0] = 1e-12
    left, sizes, turn = np.linalg.svd(J / scale, full_matrices=False)
    inverse = turn.T / np.maximum(sizes, 1e-9 * sizes[0])
    bread, influence = inverse @ inverse.T / np.outer(scale, scale), inverse @ left.T / scale[:, None]
    cov, reach, effective = covariance.of_unknowns(problem, forces, pressed, residuals, J, influence)
    errors = np.sqrt(np.maximum(np.diag(cov), covariance.TINY))
    toward = cov / errors**2 * reach
    intervals = {p.name: linear_interval(problem, x, i, toward[i, i]) for i, p in enumerate(problem.parameters)}
    if profiles:
        levels = least + reach**2 / np.maximum(np.diag(bread), 1e-300)
        include_profiles(problem, minima, toward, levels, list(intervals.values()))
    return Estimate(
        problem.parameters, intervals, problem.touches(x), problem.names, cov / np.outer(errors, errors),
        float(sizes[0] / max(sizes[-1], 1e-300)), forces, pressed, residuals, (effective, count), converged,
        least / count, runs(weighted), x, errors, minima=[y for y, squares in minima if squares <= LIKELY * least],
    )  # fmt: skip


def _search_minima(problem: Problem, begin: Sequence[np.ndarray]) -> tuple[list[tuple[np.ndarray, float]], float]:
    """The distinct minima (unknowns, squares) that least squares reach from several starts, the best one first, and the
    share of the starts that converged to it."""
    found = [problem.solve(each) for each in begin or starts(problem)]
    best, least = min(found, key=lambda pair: pair[1])
    converged = sum(squares <= least * 1.01 + 1e-12 for _, squares in found) / len(found)
    found += [problem.solve(np.clip(each, *problem.bounds)) for each in problem.other_minima(best)]
    return _distinct(found, len(problem.parameters)), converged


def _distinct(found: Sequence[tuple[np.ndarray, float]], parameters: int) -> list[tuple[np.ndarray, float]]:
    """The minima (unknowns, squares) whose first `parameters` unknowns differ, in the order of their squares."""
    out: list[tuple[np.ndarray, float]] = []
    for x, squares in sorted(found, key=lambda pair: pair[1]):
        if all(np.abs(x - y)[:parameters].max() > APART for y, _ in out):
            out.append((x, squares))
    return out


def _waves(hum: Hum, elapsed: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Shapes (n,) of a line: its sine and cosine, and its derivative by the cycles over that at the ends."""
    turn = 2.0 * math.pi * hum.cycles * elapsed
    sine, cosine = np.sin(turn), np.cos(turn)
    change = (hum.sine * cosine - hum.cosine * sine) / math.hypot(hum.sine, hum.cosine)
    return [("sine", sine), ("cosine", cosine), ("frequency", (2.0 * elapsed - 1.0) * change)]


def from_minima(other: Problem, best: Estimate) -> list[np.ndarray]:
    """Starts of a problem with more unknowns: the minima of a fit."""
    first = dict(zip(other.names, other.start(), strict=True))
    known = [first | dict(zip(best.names, x, strict=True)) for x in best.minima]
    return [np.array([each[name] for name in other.names]) for each in known]


def starts(problem: Problem) -> list[np.ndarray]:
    """The initial guess, and others drawn around it: shape parameters and touch points. Scales and baselines follow
    from these. A law without shape parameters needs fewer."""
    rng, begin, (low, high) = np.random.default_rng(0), problem.start(), problem.bounds
    wide, first = np.zeros(len(begin)), len(problem.parameters)
    wide[:first] = np.where([p.log for p in problem.parameters], 1.4, 0.15 * (high - low)[:first])
    scaled = int(problem.law.proportional)
    wide[:scaled] = 0.0
    if problem.free_touch:
        wide[first : first + len(problem.presses)] = 1.0
    count = STARTS if first > scaled else TOUCH_STARTS if problem.free_touch else 1
    return [begin] + [np.clip(begin + rng.uniform(-1.0, 1.0, len(begin)) * wide, low, high) for _ in range(count - 1)]


def widen_by_scatter(problem: Problem, pooled: Estimate) -> None:
    """Fit each press separately and widen the pooled intervals to t s/sqrt(n) of these n values."""
    if len(problem.presses) < 2:
        return
    alone = [estimate(problem.with_changes([press]), profiles=False) for press in problem.presses]
    n = len(alone)
    for p in problem.parameters:
        values = np.array([each.values[p.name] for each in alone])
        interval = pooled.intervals[p.name]
        interval.presses = values.tolist()
        scale = np.log(values) if p.log else values
        reach = float(student.ppf(0.5 + LEVEL / 2, n - 1) * scale.std(ddof=1) / math.sqrt(n))
        middle = p.to_search(interval.value)
        low, high = p.value(middle - reach), p.value(middle + reach)
        interval.low, interval.high = min(interval.low, low), max(interval.high, high)
