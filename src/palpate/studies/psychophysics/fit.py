"""A psychometric function by maximum likelihood, with profile-likelihood intervals.

The log likelihood of k_i hits in n_i trials at the levels x_i,

    l = Σ k_i ln ψ(x_i) + (n_i - k_i) ln(1 - ψ(x_i)),

is computed on a grid of a, b and the free rates; the grid is refined where l is high. From its `STARTS` best points a
bounded quasi-Newton method (TNC) finds the maximum. The interval of a is
{ a : max l - max_{b, λ, γ} l(a) <= χ²_{1; 0.95}/2 }, likewise for b (Pawitan, In All Likelihood, 2001, ch. 3.4); its
ends are bracketed by the grid and found by the same method. An interval that the levels do not bound is open: it ends
at 0 or infinity. A maximum at a limit of b or λ is named: then the data do not determine the function.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize
from scipy.special import xlog1py, xlogy

from palpate.studies.psychophysics.functions import FUNCTIONS

DROP = 1.920729  # Half of the 95 % quantile of χ² with one degree of freedom
POINTS = 41  # Grid points of a and of b
LAPSES = np.linspace(0.0, 0.1, 11)
GUESSES = np.linspace(0.0, 0.5, 26)
STARTS = 4
HALVINGS = 9  # of the bracket of an end of an interval
TINY = 1e-12  # [1] Least probability of an answer, so that the logarithm is finite
FAR = 12.0  # The finer grid leaves out points with a log likelihood this far below the maximum


@dataclass(frozen=True)
class IntervalEstimate:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def known(self) -> bool:
        """Whether the levels bound the interval on at least one side."""
        return math.isfinite(self.high) or (math.isfinite(self.low) and self.low != 0.0)

    def times(self, factor: float) -> IntervalEstimate:
        """The estimate in another unit; a negative factor swaps the ends of the interval."""
        low, high = sorted((factor * self.low, factor * self.high))
        return IntervalEstimate(factor * self.value, low, high)


@dataclass(frozen=True)
class Fit:
    """A fitted function: a and b with intervals, and the rates at the maximum of the likelihood.

    likelihood  largest log likelihood
    limits      limits of the search at which the maximum lies
    """

    function: str
    threshold: IntervalEstimate
    spread: IntervalEstimate
    guess: float
    lapse: float
    likelihood: float = math.nan
    limits: tuple[str, ...] = ()


def fit(
    function: str, x: ArrayLike, hits: ArrayLike, guess: float | None, lapsing: bool = False, positive: bool = False
) -> Fit:
    """Fit a function by maximum likelihood.

    x        level of each trial; -inf: a trial without signal
    hits     whether the answer of each trial is a hit
    guess    γ; None: free
    positive whether a is a distance, above 0
    lapsing  equal rates at both ends: γ = λ; overrides `guess`

    ValueError: no level is finite.
    """
    levels, at = np.unique(np.asarray(x, float), return_inverse=True)
    k, n = np.bincount(at, np.asarray(hits, float)), np.bincount(at).astype(float)
    guesses = GUESSES.tolist() if guess is None and not lapsing else [guess or 0.0]
    rates = [(lapse if lapsing else low, lapse) for lapse in LAPSES.tolist() for low in guesses]
    seen = levels[np.isfinite(levels)]
    if not len(seen):
        raise ValueError("no level to fit")
    a, b = _wide(function, seen)
    if positive and function != "weibull":
        a = np.linspace(a[-1] * 1e-4, a[-1], len(a))
    wide = (float(a[0]), float(a[-1])), (float(b[0]), float(b[-1]))
    for _ in range(3):
        best, which = _profiled(function, levels, k, n, a, b, rates)
        peak = np.unravel_index(int(np.argmax(best)), best.shape)
        near = best > best[peak] - FAR
        last = a, b
        a, b = _finer(a, near.any(axis=1), function == "weibull"), _finer(b, near.any(axis=0), True)
    likelihood = Likelihood(function, levels, k, n, guess, lapsing, wide)
    a, b = last
    tops = np.argsort(-best, axis=None)[:: len(a)][:STARTS]
    starts = [(a[i], b[j], *rates[which[i, j]]) for i, j in zip(*np.unravel_index(tops, best.shape), strict=True)]
    peaks = [likelihood.maximum(start) for start in starts]
    most, (x_a, x_b, low, miss) = max(peaks)
    bottom = 0.0 if positive or function == "weibull" else -math.inf
    limits = [name for name, at_limit in (
        ("the steepest slope", x_b <= 1.001 * wide[1][0]), ("the flattest slope", x_b >= 0.999 * wide[1][1]),
        ("the largest lapse rate", miss >= LAPSES[-1] - 1e-6),
    ) if at_limit]  # fmt: skip
    through = (x_a, x_b, low, miss)
    return Fit(
        function, _interval(likelihood, 0, a, best.max(axis=1), through, most, bottom),
        _interval(likelihood, 1, b, best.max(axis=0), through, most, 0.0), low, miss, most, tuple(limits),
    )  # fmt: skip


class Likelihood:
    """Log likelihood of a function as a function of (a, b, γ, λ), and its bounded maxima.

    wide  limits of a and of b
    """

    def __init__(
        self, function: str, levels: np.ndarray, k: np.ndarray, n: np.ndarray, guess: float | None, lapsing: bool,
        wide: tuple[tuple[float, float], tuple[float, float]],
    ) -> None:  # fmt: skip
        self.core, self.levels, self.k, self.n = FUNCTIONS[function], levels, k, n
        self.guess, self.lapsing, (self.a, self.b) = guess, lapsing, wide

    def full(self, rest: np.ndarray, fixed: int, value: float) -> tuple[float, float, float, float]:
        """(a, b, γ, λ) from the free numbers, with b as its logarithm; fixed: 0 a, 1 b, -1 none, at this value."""
        free = [float(each) for each in rest]
        a = value if fixed == 0 else free.pop(0) * (self.a[1] - self.a[0]) + self.a[0]
        b = value if fixed == 1 else math.exp(free.pop(0))
        miss = free.pop(0)
        low = miss if self.lapsing else self.guess if self.guess is not None else free.pop(0)
        return a, b, low, miss

    def value(self, point: tuple[float, float, float, float]) -> float:
        a, b, low, miss = point
        core = self.core(self.levels, np.array(a), np.array(b))
        p = np.clip(low + (1.0 - low - miss) * core, TINY, 1.0 - TINY)
        return float((xlogy(self.k, p) + xlog1py(self.n - self.k, -p)).sum())

    def maximum(
        self, start: tuple[float, float, float, float], fixed: int = -1, value: float = 0.0
    ) -> tuple[float, tuple[float, float, float, float]]:
        """The largest log likelihood near a start, and its point; at least that of the start."""
        a, b, low, miss = start
        first, bounds = [], []
        if fixed != 0:
            first.append((a - self.a[0]) / (self.a[1] - self.a[0]))
            bounds.append((0.0, 1.0))
        if fixed != 1:
            first.append(math.log(b))
            bounds.append((math.log(self.b[0]), math.log(self.b[1])))
        first.append(miss)
        bounds.append((LAPSES[0], LAPSES[-1]))
        if self.guess is None and not self.lapsing:
            first.append(low)
            bounds.append((GUESSES[0], GUESSES[-1]))
        first = np.clip(first, *np.array(bounds).T)
        found = optimize.minimize(
            lambda rest: -self.value(self.full(rest, fixed, value)), first, method="TNC", bounds=bounds
        )
        return max((self.value(point), point) for point in (self.full(x, fixed, value) for x in (first, found.x)))


def _wide(function: str, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grids of a and b wider than the levels can resolve; b excludes a step and a straight line."""
    low, high = float(seen.min()), float(seen.max())
    span = (high - low) or abs(high) or 1.0
    if function == "weibull":
        least = max(low, 1e-3 * high)
        return np.geomspace(least / 5.0, 5.0 * high, POINTS), np.geomspace(0.3, 10.0, POINTS)
    return np.linspace(low - 2.0 * span, high + 2.0 * span, POINTS), span * np.geomspace(0.02, 5.0, POINTS)


def _finer(grid: np.ndarray, near: np.ndarray, ratio: bool) -> np.ndarray:
    """A finer grid over the cells near the maximum, plus one cell on each side."""
    at = np.flatnonzero(near)
    ends = grid[max(at[0] - 1, 0)], grid[min(at[-1] + 1, len(grid) - 1)]
    return (np.geomspace if ratio else np.linspace)(*ends, len(grid))


def _profiled(
    function: str, levels: np.ndarray, k: np.ndarray, n: np.ndarray, a: np.ndarray, b: np.ndarray,
    rates: list[tuple[float, float]],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Log likelihood (a, b) at the best rates, and the indices of these rates."""
    core = FUNCTIONS[function](levels, a[:, None, None], b[None, :, None])
    best, which = np.full(core.shape[:2], -np.inf), np.zeros(core.shape[:2], int)
    for number, (guess, lapse) in enumerate(rates):
        p = guess + (1.0 - guess - lapse) * core
        value = (xlogy(k, p) + xlog1py(n - k, -p)).sum(axis=2)
        which[value > best] = number
        best = np.maximum(best, value)
    return best, which


def _interval(
    likelihood: Likelihood, which: int, grid: np.ndarray, profile: np.ndarray,
    peak: tuple[float, float, float, float], most: float, bottom: float,
) -> IntervalEstimate:  # fmt: skip
    """The maximum, and where the profile has fallen by `DROP` on each side; which: 0 a, 1 b."""
    limit = most - DROP
    inside = np.flatnonzero(profile >= limit)
    ends = [bottom, math.inf]
    for side, edge, step in ((0, inside.min(initial=len(grid) - 1), -1), (1, inside.max(initial=0), 1)):
        near = peak  # continue each maximum from the last one

        def above(value: float) -> float:
            nonlocal near
            top, near = likelihood.maximum(near, which, value)
            return top - limit

        held, at = peak[which], edge
        while 0 <= at < len(grid):
            value = float(grid[at])
            beyond = value < peak[which] if side == 0 else value > peak[which]
            if beyond and above(value) < 0.0:
                for _ in range(HALVINGS):  # the maximum at the last grid point is known to be above
                    middle = 0.5 * (value + held)
                    value, held = (value, middle) if above(middle) >= 0.0 else (middle, held)
                ends[side] = 0.5 * (value + held)
                break
            held, at = value if beyond else held, at + step
    return IntervalEstimate(float(peak[which]), *ends)
