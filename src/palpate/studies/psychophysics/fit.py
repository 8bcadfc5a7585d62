"""A psychometric function by Bayesian inference on a grid, with 95 % intervals of the marginal posterior.

The likelihood of k_i hits in n_i trials at the levels x_i is binomial,

    l(a, b, λ, γ) = Σ k_i ln ψ(x_i) + (n_i - k_i) ln(1 - ψ(x_i)),

with weak priors (Schütt, Harmeling, Macke & Wichmann, Vision Research 122, 2016, sec. 2.3, with a spread that is
uniform in its logarithm):

    a     uniform over the levels, then falling as a cosine to 0 at half of their range on each side
    b     uniform in ln b between limits that exclude a step and a straight line, falling as a cosine outside
    λ, γ  Beta(1, 10), unless fixed

An estimate is the median of the marginal posterior, its interval the central 95 %. Unlike the interval of a profile
likelihood it averages over the rates and the spread, so that few trials, which can often be fitted best by a step with
many lapses, do not decide these. The rule that chooses the levels and the end of a session is no part of the
likelihood, because it depends on earlier answers only. The rates of coverage are those of `benchmarks/experiments.py`.

An end of an interval that the answers do not bound is open: it lies where the profile likelihood has not fallen by half
of the 95 % quantile of χ². An estimate of which the prior decides more than the answers is named in `limits`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import xlog1py, xlogy

from palpate.studies.psychophysics.functions import FUNCTIONS, proportion

DROP = 1.920729  # Half of the 95 % quantile of χ² with one degree of freedom
POINTS = 60  # Grid points of a and of b
RATES = np.array([0.0, 0.005, 0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1, 0.13, 0.17, 0.22, 0.28, 0.35, 0.45])
FAR = 10.0  # The finer grid leaves out a and b with a log posterior this far below the maximum
TINY = 1e-12  # [1] Least probability of an answer, so that the logarithm is finite


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
class Grid:
    """Posterior on a grid.

    a, b, low, miss   coordinates (n), (m), (r), (r) of threshold, spread, guess rate and lapse rate
    weight            posterior mass (n, m, r)
    """

    a: np.ndarray
    b: np.ndarray
    low: np.ndarray
    miss: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class Fit:
    """A fitted function: the medians of a and b with their intervals, and the mean rates.

    limits  what the answers do not determine
    grid    the posterior
    """

    function: str
    threshold: IntervalEstimate
    spread: IntervalEstimate
    guess: float
    lapse: float
    limits: tuple[str, ...] = ()
    grid: Grid | None = field(default=None, repr=False)

    def curve(self, x: ArrayLike) -> np.ndarray:
        """Mean and limits of the central 95 % of ψ (3, n) at the levels x, over the posterior."""
        assert self.grid is not None
        g, at = self.grid, np.asarray(x, float)
        flat = g.weight.ravel()
        keep = np.flatnonzero(flat > 1e-5 * flat.max())
        i, j, r = np.unravel_index(keep, g.weight.shape)
        weight = flat[keep] / flat[keep].sum()
        rows = [_summary(proportion(self.function, one, g.a[i], g.b[j], g.low[r], g.miss[r]), weight) for one in at]
        return np.array(rows).T


def fit(
    function: str, x: ArrayLike, hits: ArrayLike, guess: float | None, lapsing: bool = False, positive: bool = False
) -> Fit:
    """Fit a function.

    x        level of each trial; -inf: a trial without signal
    hits     whether the answer of each trial is a hit
    guess    γ; None: free
    positive whether a is a distance, above 0
    lapsing  equal rates at both ends: γ = λ; overrides `guess`

    ValueError: no level is finite.
    """
    levels, at = np.unique(np.asarray(x, float), return_inverse=True)
    k, n = np.bincount(at, np.asarray(hits, float)), np.bincount(at).astype(float)
    seen = levels[np.isfinite(levels)]
    if not len(seen):
        raise ValueError("no level to fit")
    low, miss, rate_prior = _rates(guess, lapsing)
    prior = Prior(function, seen, positive)
    a, b = prior.grids()
    for _ in range(2):
        likelihood = _likelihood(function, levels, k, n, a, b, low, miss)
        post = likelihood + prior(a, b)[:, :, None] + rate_prior
        near = post.max(axis=2) > post.max() - FAR
        last = a, b
        a, b = _finer(a, near.any(axis=1), prior.ratio), _finer(b, near.any(axis=0), True)
    a, b = last
    weight = np.exp(post - post.max())
    weight *= (_cells(a)[:, None] * _cells(b))[:, :, None]  # the prior is a density per a and per b
    weight /= weight.sum()
    top = likelihood.max()
    ends = [_open(likelihood.max(axis=axes) - top) for axes in ((1, 2), (0, 2))]
    bottoms = 0.0 if positive or function == "weibull" else -math.inf, 0.0
    threshold, spread = (
        _estimate(values, weight.sum(axis=axes), end, bottom)
        for values, axes, end, bottom in zip((a, b), ((1, 2), (0, 2)), ends, bottoms, strict=True)
    )
    rates = weight.sum(axis=(0, 1))
    names = "the threshold", "the spread"
    limits = [f"the answers do not bound {name} {side}" for name, end in zip(names, ends, strict=True)
              for side, unbounded in zip(("below", "above"), end, strict=True) if unbounded]  # fmt: skip
    if rates[miss >= 0.1].sum() > 0.5:
        limits.append("more than 10 % of the answers do not depend on the level")
    return Fit(
        function, threshold, spread, _summary(low, rates)[0], _summary(miss, rates)[0], tuple(limits),
        Grid(a, b, low, miss, weight),
    )  # fmt: skip


class Prior:
    """Log density over (a, b), for levels that were seen."""

    def __init__(self, function: str, seen: np.ndarray, positive: bool) -> None:
        low, high = float(seen.min()), float(seen.max())
        span = (high - low) or abs(high) or 1.0
        self.ratio = function == "weibull"
        if self.ratio:
            low = max(low, 1e-3 * high)
            room = max(math.log(high / low), math.log(2.0))
            self.a = math.log(low), math.log(high), 0.5 * room
            self.b = math.log(0.7), math.log(6.0), math.log(2.0)
        else:
            self.a = low, high, 0.5 * span
            gap = float(np.diff(np.unique(seen)).min()) if len(np.unique(seen)) > 1 else 0.1 * span
            self.b = math.log(max(0.5 * gap, 0.03 * span)), math.log(span), math.log(3.0)
        self.positive = positive

    def grids(self) -> tuple[np.ndarray, np.ndarray]:
        (low, high, room), (least, most, slack) = self.a, self.b
        bottom = low - room
        if self.positive and not self.ratio:
            bottom = max(bottom, 1e-4 * high)
        a = np.linspace(bottom, high + room, POINTS)
        return np.exp(a) if self.ratio else a, np.exp(np.linspace(least - slack, most + slack, POINTS))

    def __call__(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        along = _plateau(np.log(a) if self.ratio else a, *self.a)
        jacobian = np.log(a) if self.ratio else np.zeros_like(a)  # a uniform density in ln a is 1/a in a
        return (along - jacobian)[:, None] + _plateau(np.log(b), *self.b) - np.log(b)


def _plateau(x: np.ndarray, low: float, high: float, room: float) -> np.ndarray:
    """Logarithm of a density that is constant from low to high and falls as a cosine over `room` on each side."""
    beyond = np.clip(np.maximum(low - x, x - high) / room, 0.0, 1.0)
    return np.log(np.maximum(0.5 * (1.0 + np.cos(np.pi * beyond)), TINY))


def _rates(guess: float | None, lapsing: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Guess and lapse rates of the grid, and the logarithm of prior times cell size."""
    one = 9.0 * np.log1p(-RATES) + np.log(_cells(RATES))
    if lapsing:
        return RATES, RATES, one
    if guess is not None:
        return np.full_like(RATES, guess), RATES, one
    low, miss = (grid.ravel() for grid in np.meshgrid(RATES, RATES, indexing="ij"))
    return low, miss, (one[:, None] + one).ravel()


def _cells(grid: np.ndarray) -> np.ndarray:
    """Length of the cell around each point: weights of the trapezoid rule."""
    steps = np.diff(grid)
    return 0.5 * (np.concatenate([steps, [0.0]]) + np.concatenate([[0.0], steps]))


def _finer(grid: np.ndarray, near: np.ndarray, ratio: bool) -> np.ndarray:
    """A finer grid over the cells near the maximum, plus one cell on each side."""
    at = np.flatnonzero(near)
    ends = grid[max(at[0] - 1, 0)], grid[min(at[-1] + 1, len(grid) - 1)]
    return (np.geomspace if ratio else np.linspace)(*ends, len(grid))


def _likelihood(
    function: str, levels: np.ndarray, k: np.ndarray, n: np.ndarray, a: np.ndarray, b: np.ndarray,
    low: np.ndarray, miss: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Log likelihood (a, b, rates)."""
    core = FUNCTIONS[function](levels, a[:, None, None], b[None, :, None])
    values = []
    for guess, lapse in zip(low, miss, strict=True):
        p = np.clip(guess + (1.0 - guess - lapse) * core, TINY, 1.0 - TINY)
        values.append(xlogy(k, p).sum(axis=2) + xlog1py(n - k, -p).sum(axis=2))
    return np.stack(values, axis=2)


def _summary(values: np.ndarray, weight: np.ndarray) -> tuple[float, float, float]:
    """Mean and limits of the central 95 % of a weighted sample."""
    order = np.argsort(values)
    share = np.cumsum(weight[order])
    low, high = (values[order][min(np.searchsorted(share, q * share[-1]), len(share) - 1)] for q in (0.025, 0.975))
    return float(np.average(values, weights=weight)), float(low), float(high)


def _open(profile: np.ndarray) -> tuple[bool, bool]:
    """Whether a profile likelihood, less its maximum, has not fallen enough at the two ends of the grid."""
    return bool(profile[0] > -DROP), bool(profile[-1] > -DROP)


def _estimate(values: np.ndarray, weight: np.ndarray, unbounded: Sequence[bool], bottom: float) -> IntervalEstimate:
    """Median and central 95 % of a marginal posterior; ends that the answers do not bound are open."""
    share = np.concatenate([[0.0], np.cumsum(weight)])
    edges = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1]), values[-1:]])
    low, middle, high = np.interp([0.025, 0.5, 0.975], share / share[-1], edges)
    return IntervalEstimate(
        float(middle), bottom if unbounded[0] else float(low), math.inf if unbounded[1] else float(high)
    )
