"""Least squares with honest intervals: what presses say of the parameters of a law, and what they do not.

Residuals of a press are correlated: its noise is filtered, and no law is exact. So many of them count as few,

    n_eff = n/tau,    tau = 1 + 2 sum rho_k,    s² = SSR/n n_eff/(n_eff - p),    cov = s² tau (J'J)^-1

with the autocorrelation rho of the residuals, corrected for its bias in short records (F. H. C. Marriott, J. A. Pope,
Biometrika 41 (1954) 390-402), and Student's t of n_eff - p. Profiles are cut at the same level. Of several presses, the
scatter from press to press bounds the interval from below.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue import relaxing
from palpate.models.fit.tissue.measured import Press
from palpate.models.fit.tissue.residuals import inflation, runs
from palpate.models.fit.tissue.rigs import Law, Parameter

STARTS = 10
ALIKE = 0.97
"""[1] Correlation from which two parameters cannot be told apart."""
LEVEL = 0.95
LEAST_EFFECTIVE = 3.0
"""Independent residuals for each number to find, at least: a law that misses the curve leaves fewer, and no statistics
then tell how wrong its numbers are. The report gives the misfit apart."""


@dataclass
class Interval:
    """95 % interval of a parameter: the widest of the linear one, that of the profile (nan: open on that side) and that
    of the scatter from press to press."""

    value: float
    low: float
    high: float
    profile: tuple[float, float] = (math.nan, math.nan)
    curve: list[tuple[float, float]] = field(default_factory=list)
    presses: list[float] = field(default_factory=list)


@dataclass
class Estimate:
    """What a fit found; arrays by press.

    correlation  of all that was found: `names`, touch points and zeros of force last
    condition    of the scaled sensitivities
    effective    independent residuals, of how many
    starts       share of the starts that came to this minimum
    squares      mean square of the weighted residuals
    at, errors   what was found, in the search's own numbers as in `names`, and its standard errors
    withheld     whether the law misfits so far that the intervals are the whole range of the search
    """

    parameters: tuple[Parameter, ...]
    intervals: dict[str, Interval]
    touches: list[float]
    names: list[str]
    correlation: np.ndarray
    condition: float
    fitted: list[np.ndarray]
    residuals: list[np.ndarray]
    effective: tuple[float, int]
    starts: float
    squares: float
    runs: float
    at: np.ndarray
    errors: np.ndarray
    withheld: bool = False

    def number(self, name: str) -> tuple[float, float]:
        """What was found, in the search's own numbers, with its standard error; (0, 0): it was not searched."""
        if name not in self.names:
            return 0.0, 0.0
        return float(self.at[self.names.index(name)]), float(self.errors[self.names.index(name)])

    def withhold(self) -> None:
        """Give no intervals: they become the whole range of the search."""
        self.withheld = True
        for p in self.parameters:
            self.intervals[p.name].low, self.intervals[p.name].high = p.low, p.high

    @property
    def values(self) -> dict[str, float]:
        return {name: interval.value for name, interval in self.intervals.items()}


class Problem:
    """Presses, a law and its relaxation: the residual vector in the search's own numbers.

    free_touch  whether the touch point of each press is found too
    relative    weigh by the force itself, at least 5 % of the peak, not evenly
    """

    def __init__(self, presses: Sequence[Press], law: Law, kind: str, free_touch: bool, relative: bool) -> None:
        self.presses, self.law, self.kind = list(presses), law, kind
        lengths = [float(np.ptp(p.time)) for p in presses if p.time is not None]
        if kind != "none" and len(lengths) < len(presses):
            raise SessionError(f"--relaxation {kind}: expected a column of time in every file")
        self.parameters = (*law.parameters, *relaxing.parameters(kind, max(lengths, default=1.0)))
        self.free_touch, self.relative = free_touch, relative
        peaks = [float(np.abs(p.force).max()) for p in presses]
        self.weight = [
            1.0 / (np.maximum(np.abs(p.force), 0.05 * peak) if relative else np.full(len(p.force), peak))
            for p, peak in zip(presses, peaks, strict=True)
        ]
        self.baselines = []
        for i, (press, peak) in enumerate(zip(self.presses, peaks, strict=True)):
            self.baselines.append((f"zero, {press.name}", i, np.full(len(press.force), 0.01 * peak)))
            if press.drifts:
                self.baselines.append((f"drift, {press.name}", i, 0.01 * peak * press.elapsed))
        self.names = [p.name for p in self.parameters]
        self.names += [f"touch, {p.name}" for p in presses] if free_touch else []
        self.names += [name for name, _, _ in self.baselines]
        self.count = sum(len(p.force) for p in presses)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        low = [p.searched(p.low) for p in self.parameters]
        high = [p.searched(p.high) for p in self.parameters]
        if self.free_touch:  # in units of what the force leaves open
            low += [-2.0] * len(self.presses)
            high += [2.0] * len(self.presses)
        limits = [10.0 if self.presses[i].air and name.startswith("zero") else 100.0 for name, i, _ in self.baselines]
        low += [-limit for limit in limits]  # in percent of the peak
        high += limits
        return np.array(low), np.array(high)

    def values(self, x: np.ndarray) -> dict[str, float]:
        return {p.name: p.value(v) for p, v in zip(self.parameters, x, strict=False)}

    def touches(self, x: np.ndarray) -> list[float]:
        first = len(self.parameters)
        off = x[first : first + len(self.presses)] if self.free_touch else np.zeros(len(self.presses))
        return [p.touch + float(o) * p.slack for p, o in zip(self.presses, off, strict=True)]

    def forces(self, x: np.ndarray) -> list[np.ndarray]:
        values = self.values(x)
        forces = [
            relaxing.force(self.kind, self.law, values, press, touch)
            for press, touch in zip(self.presses, self.touches(x), strict=True)
        ]
        for (_, i, column), size in zip(self.baselines, x[len(x) - len(self.baselines) :], strict=True):
            forces[i] = forces[i] + size * column
        return forces

    def residuals(self, x: np.ndarray) -> np.ndarray:
        parts = [(f - p.force) * w for f, p, w in zip(self.forces(x), self.presses, self.weight, strict=True)]
        out = np.concatenate(parts)
        return np.where(np.isfinite(out), np.clip(out, -1e6, 1e6), 1e6)

    def start(self) -> np.ndarray:
        """The guesses, the first parameter scaled so that the forces are of the size measured."""
        guess = [p.searched(p.guess) for p in self.parameters]
        x = np.array(guess + [0.0] * ((len(self.presses) if self.free_touch else 0) + len(self.baselines)))
        made = float(np.linalg.norm(np.concatenate(self.forces(x))))
        found = float(np.linalg.norm(np.concatenate([p.force for p in self.presses])))
        if self.parameters[0].log and made > 0.0 and math.isfinite(made):
            x[0] += math.log(found / made)
        return np.clip(x, *self.bounds())

    def solve(self, x: np.ndarray, held: int | None = None) -> tuple[np.ndarray, float]:
        """The minimum from x, one number held or none; and its sum of squares."""
        low, high = self.bounds()
        free = np.arange(len(x)) != (-1 if held is None else held)

        def whole(part: np.ndarray) -> np.ndarray:
            y = x.copy()
            y[free] = part
            return y

        if not free.any():
            return x, float(np.sum(self.residuals(x) ** 2))
        inside = np.clip(x[free], low[free] + 1e-9, high[free] - 1e-9)
        found = least_squares(
            lambda part: self.residuals(whole(part)), inside,
            jac="2-point" if self.law.slopes is None else lambda part: self.jacobian(whole(part))[:, free],
            bounds=(low[free], high[free]), x_scale="jac", max_nfev=200,
        )  # fmt: skip
        return whole(found.x), 2.0 * float(found.cost)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """(rows, numbers) Derivatives of the residuals: of a law with slopes its own, else by differences."""
        if self.law.slopes is None:
            return self._differences(x)
        values, first = self.values(x), len(self.parameters)
        blocks = []
        for i, (press, touch, w) in enumerate(zip(self.presses, self.touches(x), self.weight, strict=True)):
            before, by = relaxing.slopes(self.kind, self.law, values, press, touch)
            block = np.zeros((len(press.force), len(x)))
            for k, p in enumerate(self.parameters):
                block[:, k] = by[p.name] * (values[p.name] if p.log else 1.0)
            if self.free_touch:
                block[:, first + i] = before * press.slack
            for k, (_, of, column) in enumerate(self.baselines, len(x) - len(self.baselines)):
                if of == i:
                    block[:, k] = column
            blocks.append(block * w[:, None])
        return np.nan_to_num(np.concatenate(blocks), posinf=0.0, neginf=0.0)

    def _differences(self, x: np.ndarray) -> np.ndarray:
        low, high = self.bounds()
        step = 1e-4
        columns = []
        for i in range(len(x)):
            up, down = x.copy(), x.copy()
            up[i], down[i] = min(x[i] + step, high[i]), max(x[i] - step, low[i])
            columns.append((self.residuals(up) - self.residuals(down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)


def estimate(problem: Problem, profiles: bool = True, begin: np.ndarray | None = None) -> Estimate:
    """Fit from several starts, or from this one alone, with intervals.

    SessionError: fewer rows than numbers to find.
    """
    count, size = problem.count, len(problem.start())
    if count < 3 * size:
        raise SessionError(
            f"{count} rows are left for {size} numbers to find; expected at least {3 * size}. Left out are rows beyond "
            "--depth-limit and, without --relaxation, those after the deepest"
        )
    rng = np.random.default_rng(0)
    low, high = problem.bounds()
    starts, begin, found = (STARTS, problem.start(), []) if begin is None else (1, begin, [])
    for k in range(starts):
        wide = np.where([p.log for p in problem.parameters], 1.4, 0.15 * (high - low)[: len(problem.parameters)])
        off = np.zeros(size)
        if k:
            off[: len(wide)] = rng.uniform(-1.0, 1.0, len(wide)) * wide
        found.append(problem.solve(np.clip(begin + off, low, high)))
    x, least = min(found, key=lambda pair: pair[1])
    forces = problem.forces(x)
    residuals = [(f - p.force) for f, p in zip(forces, problem.presses, strict=True)]
    weighted = [r * w for r, w in zip(residuals, problem.weight, strict=True)]
    J = problem.jacobian(x)
    tau = inflation(weighted, size)
    effective = max(count / tau, LEAST_EFFECTIVE * size)
    tau = count / effective
    variance = least / count * effective / (effective - size)
    scale = np.linalg.norm(J, axis=0)
    scale[scale == 0.0] = 1e-12
    _, sizes, turn = np.linalg.svd(J / scale, full_matrices=False)
    cov = variance * tau * (turn.T / np.maximum(sizes, 1e-9 * sizes[0]) ** 2) @ turn / np.outer(scale, scale)
    errors = np.sqrt(np.diag(cov))
    quantile = float(student.ppf(0.5 + LEVEL / 2, effective - size))
    intervals = {}
    for i, p in enumerate(problem.parameters):
        value, reach = float(x[i]), quantile * float(errors[i])
        ends = [min(max(value + s * reach, low[i]), high[i]) for s in (-1, 1)]
        intervals[p.name] = Interval(p.value(value), p.value(ends[0]), p.value(ends[1]))
        if profiles:
            level = least * (1.0 + quantile**2 / (effective - size))
            profile, points = _profile(problem, x, i, reach / 2.0, least, level)
            ends = [math.nan if math.isnan(v) else p.value(v) for v in profile]
            own = intervals[p.name]
            own.profile = (ends[0], ends[1])
            own.low = min(own.low, p.low if math.isnan(ends[0]) else ends[0])
            own.high = max(own.high, p.high if math.isnan(ends[1]) else ends[1])
            own.curve = sorted((p.value(v), (c - least) / max(level - least, 1e-300)) for v, c in points)
    alike = sum(c <= least * 1.01 + 1e-12 for _, c in found) / starts
    return Estimate(
        problem.parameters, intervals, problem.touches(x), problem.names, cov / np.outer(errors, errors),
        float(sizes[0] / max(sizes[-1], 1e-300)), forces, residuals, (effective, count), alike, least / count,
        runs(weighted), x, errors,
    )  # fmt: skip


def _profile(
    problem: Problem, x: np.ndarray, i: int, step: float, least: float, level: float
) -> tuple[tuple[float, float], list[tuple[float, float]]]:
    """Where the least sum of squares with one number held rises to a level on both sides, nan: nowhere; and points."""
    low, high = problem.bounds()
    ends, points = [], [(float(x[i]), least)]
    for side in (-1.0, 1.0):
        bound = low[i] if side < 0 else high[i]
        inner, outer, at, reach = float(x[i]), math.nan, x.copy(), max(step, 1e-6)
        for _ in range(14):
            trial = at.copy()
            trial[i] = bound if side * (inner + side * reach - bound) >= 0 else inner + side * reach
            solved, cost = problem.solve(trial, i)
            points.append((float(trial[i]), cost))
            if cost >= level:
                outer = float(trial[i])
                break
            inner, at = float(trial[i]), solved
            if trial[i] == bound:
                break
            reach *= 2.0
        if math.isnan(outer):
            ends.append(math.nan)
            continue
        for _ in range(6):  # bisection
            trial = at.copy()
            trial[i] = 0.5 * (inner + outer)
            solved, cost = problem.solve(trial, i)
            points.append((float(trial[i]), cost))
            if cost >= level:
                outer = float(trial[i])
            else:
                inner, at = float(trial[i]), solved
        ends.append(0.5 * (inner + outer))
    return (ends[0], ends[1]), points


def between(problem: Problem, made: Callable[[list[Press]], Problem], pooled: Estimate) -> None:
    """Fit each press by itself and widen the intervals to what the scatter between them allows."""
    if len(problem.presses) < 2:
        return
    alone = [estimate(made([press]), profiles=False) for press in problem.presses]
    n = len(alone)
    for p in problem.parameters:
        own = np.array([each.values[p.name] for each in alone])
        interval = pooled.intervals[p.name]
        interval.presses = own.tolist()
        scale = np.log(own) if p.log else own
        reach = float(student.ppf(0.5 + LEVEL / 2, n - 1) * scale.std(ddof=1) / math.sqrt(n))
        middle = p.searched(interval.value)
        low, high = p.value(middle - reach), p.value(middle + reach)
        interval.low, interval.high = min(interval.low, low), max(interval.high, high)
