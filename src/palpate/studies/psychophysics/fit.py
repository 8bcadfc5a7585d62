"""A psychometric function by maximum likelihood, with profile-likelihood intervals.

The log likelihood of k_i hits in n_i trials at the levels x_i,

    l = Σ k_i ln ψ(x_i) + (n_i - k_i) ln(1 - ψ(x_i)),

is computed on a grid of a, b and the free rates; the grid is then refined where l is high. The interval of a is
{ a : max l - max_{b, λ, γ} l(a) <= χ²_{1; 0.95}/2 }, likewise for b (Pawitan, In All Likelihood, 2001, ch. 3.4). An
interval that the levels do not bound is open: it ends at 0 or infinity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import xlog1py, xlogy

from palpate.studies.psychophysics.functions import FUNCTIONS

DROP = 1.920729  # Half of the 95 % quantile of χ² with one degree of freedom
POINTS = 41  # Grid points of a and of b
LAPSES = np.linspace(0.0, 0.1, 11)
GUESSES = np.linspace(0.0, 0.5, 26)
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
    """A fitted function: a and b with intervals, and the rates at the maximum of the likelihood."""

    function: str
    threshold: IntervalEstimate
    spread: IntervalEstimate
    guess: float
    lapse: float


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
    for _ in range(3):
        best, which = _profiled(function, levels, k, n, a, b, rates)
        peak = np.unravel_index(int(np.argmax(best)), best.shape)
        near = best > best[peak] - FAR
        last = a, b
        a, b = _finer(a, near.any(axis=1), function == "weibull"), _finer(b, near.any(axis=0), True)
    a, b = last
    low, miss = rates[int(which[peak])]
    return Fit(function, _interval(a, best.max(axis=1), 0.0 if positive or function == "weibull" else -math.inf),
               _interval(b, best.max(axis=0), 0.0), low, miss)  # fmt: skip


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


def _interval(grid: np.ndarray, profile: np.ndarray, bottom: float) -> IntervalEstimate:
    """Best point of the grid, and where the profile has fallen by `DROP` on each side, by linear interpolation."""
    at, limit = int(np.argmax(profile)), profile.max() - DROP
    inside = np.flatnonzero(profile >= limit)
    low, high = bottom, math.inf
    if inside[0] > 0:
        low = float(np.interp(limit, profile[inside[0] - 1 : inside[0] + 1], grid[inside[0] - 1 : inside[0] + 1]))
    if inside[-1] < len(grid) - 1:
        high = float(np.interp(-limit, -profile[inside[-1] : inside[-1] + 2], grid[inside[-1] : inside[-1] + 2]))
    return IntervalEstimate(float(grid[at]), low, high)
