"""Bounded least squares over a few unknowns whose residuals cost a run: a trust region with secant updates.

At x, with residuals r and an estimate B of their derivatives, a step d minimizes |r + B d|² in the box |d_i| <= D s_i
within the bounds. The run at x + d also improves B, by the least change that agrees with it,

    B <- B + (r(x + d) - r - B d) d'S / (d'S d),    S = diag s_i^-2,

so that a step costs one run. Where x + d is hardly better than x, a second step from there with the same B follows a
bent valley of the sum of squares: it is half of the geodesic acceleration. One run for each unknown computes B again,
by forward differences, where a step decreases the sum of squares by less than `POOR` of what B predicts.

C. G. Broyden, Math. Comp. 19 (1965) 577-593; J. E. Dennis, R. B. Schnabel, Numerical Methods for Unconstrained
Optimization and Nonlinear Equations, SIAM 1996, ch. 6, 8 and 10; M. K. Transtrum, J. P. Sethna, arXiv:1201.5885 (2012).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

POOR, GOOD = 0.25, 0.75  # [1] Decrease over the predicted one: derivatives are computed again; the box may grow
BENT = 0.75  # [1] Length of the second step over that of the first one up to which it follows a bent valley
FIRST = 1.0  # [1] D of the first step: a factor of e of a positive setting, a scale of others
LEAST = 1e-9  # [1] D below which the search ends
MOST = 60  # runs of one search


@dataclass
class Point:
    """Where a search is.

    x       (n) unknowns;  r (rows) residuals there
    slopes  (rows, n) their derivatives, or an estimate;  fresh: by differences at this x
    """

    x: np.ndarray
    r: np.ndarray
    slopes: np.ndarray
    fresh: bool = True

    @property
    def squares(self) -> float:
        return float(self.r @ self.r)


@dataclass
class Descent:
    """A search of the least sum of squares.

    residuals  (n) -> (rows)
    slopes     (n), its residuals -> (rows, n) derivatives by differences
    low, high  (n) bounds;  scales (n) of the unknowns
    """

    residuals: Callable[[np.ndarray], np.ndarray]
    slopes: Callable[[np.ndarray, np.ndarray], np.ndarray]
    low: np.ndarray
    high: np.ndarray
    scales: np.ndarray

    def run(
        self, begin: Point, tolerance: float, arrived: Callable[[Point], bool] = lambda point: False,
        renew: bool = False, most: int = MOST,
    ) -> Point:  # fmt: skip
        """The point from which no step would decrease the squares by more than `tolerance` of them.

        arrived  whether a point is good enough
        renew    compute derivatives that are not fresh again before the search ends
        most     number of runs after which it ends
        """
        at, size, left = begin, FIRST, most
        while left > 0 and not arrived(at):
            step, predicted = self.step(at, size)
            if predicted <= tolerance * at.squares or size < LEAST:
                if at.fresh or not renew:
                    break
                at, left = self.renewed(at), left - len(at.x)
                continue
            new, left = self._moved(at, step), left - 1
            if new.squares > at.squares - POOR * predicted:
                more, _ = self.step(new, size)
                if float(np.abs(more / self.scales).max()) < BENT * float(np.abs(step / self.scales).max()):
                    bent, left = self._moved(new, more), left - 1
                    new = min(new, bent, key=lambda each: each.squares)
            ratio, length = (at.squares - new.squares) / predicted, float(np.abs((new.x - at.x) / self.scales).max())
            known = at.fresh
            if ratio < POOR:  # where B is old it may be wrong instead of the size
                size = (1.0 if not known else 0.25 if ratio < 0.0 else 0.5) * length
            elif ratio > GOOD and length > 0.99 * size:
                size *= 2.0
            if ratio > 0.0:
                at = new
            if ratio < POOR and not known:
                at, left = self.renewed(at), left - len(at.x)
        return at

    def _moved(self, at: Point, step: np.ndarray) -> Point:
        """The point after a step, with the updated derivatives."""
        x = at.x + step
        r, along = self.residuals(x), step / self.scales**2
        more = np.outer((r - at.r - at.slopes @ step) / max(float(along @ step), 1e-300), along)
        return Point(x, r, at.slopes + more, False)

    def renewed(self, at: Point) -> Point:
        """The point with derivatives by differences."""
        return Point(at.x, at.r, self.slopes(at.x, at.r))

    def step(self, at: Point, size: float = math.inf) -> tuple[np.ndarray, float]:
        """The step (n) to the minimum of the linear model in the box of this size [1], and by how much it decreases
        the squares."""
        low = np.maximum(self.low - at.x, -size * self.scales) / self.scales
        high = np.minimum(self.high - at.x, size * self.scales) / self.scales
        apart = np.maximum(1e-12, 1e-9 * (np.abs(low) + np.abs(high)))
        turn, triangle = np.linalg.qr(at.slopes * self.scales)
        found = lsq_linear(triangle, -(turn.T @ at.r), (low - apart, high + apart), method="bvls").x
        step = np.clip(np.clip(found, low, high) * self.scales, self.low - at.x, self.high - at.x)
        return step, at.squares - float(np.sum((at.r + at.slopes @ step) ** 2))
