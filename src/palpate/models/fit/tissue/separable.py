"""Least squares of a force that is linear in some of its unknowns, by variable projection.

The weighted force on n rows is a g(z) + B c, with the law's force g, its scale a, and the baselines B. For each z, the
best a and c follow from linear algebra, so that only z is searched: touch points and shape parameters, at most a few
numbers. With the projection P orthogonal to B,

    r(z) = a P g - P y,    a = (P g).y/|P g|²,    dr/dz = P⊥ (a dg/dz + dB/dz c),    P⊥ orthogonal to B and P g

G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432; the derivative without its second term: L. Kaufman, BIT
15 (1975) 49-57. A baseline beyond its bound is held there. The same method fits force models of few points in
`models.fit.curve_fit`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from palpate.models.fit.tissue.bounded import minimize_squares
from palpate.models.fit.tissue.rigs import Law

REJECTED = 1e6  # [1] Residual of a force that is not finite
SINGULAR = 1e-12  # [1] Least singular value of the baselines, over the largest one


class Baselines:
    """Weighted baselines (n, k): the projection orthogonal to them, and their sizes."""

    def __init__(self, columns: np.ndarray) -> None:
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        left, values, right = np.linalg.svd(columns / size, full_matrices=False)
        kept = values > SINGULAR * values.max(initial=0.0)
        self.basis = np.ascontiguousarray(left[:, kept])
        self.inverse = (right[kept].T / values[kept]) / size[:, None]

    def project(self, vectors: np.ndarray) -> np.ndarray:
        """(n,) or (n, m) without their part in the space of the baselines."""
        out: np.ndarray = vectors - self.basis @ (self.basis.T @ vectors)
        return out

    def sizes(self, vector: np.ndarray) -> np.ndarray:
        """(k,) of the baselines whose sum is nearest to a vector (n,)."""
        out: np.ndarray = self.inverse @ (self.basis.T @ vector)
        return out


class Problem(Protocol):
    """What the method needs of `estimate.Problem`."""

    law: Law
    weight: list[np.ndarray]
    baselines: list[Any]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]: ...
    @property
    def rises(self) -> Sequence[Any]: ...
    @property
    def measured(self) -> np.ndarray: ...
    @property
    def projected(self) -> tuple[Baselines, np.ndarray]: ...
    def columns(self, x: np.ndarray) -> np.ndarray: ...
    def column_slopes(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray: ...
    def law_forces(self, x: np.ndarray) -> list[np.ndarray]: ...
    def law_slopes(self, x: np.ndarray, here: Sequence[np.ndarray], free: np.ndarray) -> np.ndarray: ...


class _Search:
    """The residuals over the unknowns z, and their derivatives.

    x      begin, in search coordinates
    fixed  an unknown that stays; -1: none
    held   which baselines (k,) stay at their values in x
    """

    def __init__(self, problem: Problem, x: np.ndarray, fixed: int, held: np.ndarray) -> None:
        self.problem, self.x, self.scaled = problem, x, problem.law.proportional and fixed != 0
        self.last = len(x) - len(held)
        self.free = np.array([k for k in range(int(problem.law.proportional), self.last) if k != fixed], int)
        self.moves = np.isin(np.arange(len(x)), self.free)
        self.low, self.high = (side[self.free] for side in problem.bounds)
        self.held = held
        if held.any() or problem.rises:
            self._project(x)
        else:
            self.measured, (self.baselines, self.target) = problem.measured, problem.projected
        self.loose = self.last + np.flatnonzero(~held)
        self.at: np.ndarray | None = None

    def _project(self, x: np.ndarray) -> None:
        """Keep the baselines at x, and the measured forces without those that are held."""
        columns = self.problem.columns(x)
        self.measured = self.problem.measured - columns[:, self.held] @ self.x[self.last :][self.held]
        self.baselines = Baselines(columns[:, ~self.held])
        self.target = self.baselines.project(self.measured)

    def whole(self, z: np.ndarray) -> np.ndarray:
        y = self.x.copy()
        y[self.free] = np.clip(z, self.low, self.high)
        return y

    def evaluate(self, z: np.ndarray) -> None:
        """Keep the force g and the scale a at z."""
        if self.at is not None and np.array_equal(z, self.at):
            return
        self.at, x = z.copy(), self.whole(z)
        if self.problem.rises:  # which end at the touch point
            self._project(x)
        self.forces = self.problem.law_forces(x)
        self.raw = np.concatenate([f * w for f, w in zip(self.forces, self.problem.weight, strict=True)])
        self.g = self.baselines.project(self.raw)
        self.square = float(self.g @ self.g)
        self.a = 1.0
        if self.scaled:
            self.a = float(self.g @ self.target) / self.square if 0.0 < self.square < math.inf else math.nan

    def residuals(self, z: np.ndarray) -> np.ndarray:
        self.evaluate(z)
        if not (math.isfinite(self.a) and math.isfinite(self.square)):
            return np.full(len(self.target), REJECTED)
        return self.a * self.g - self.target

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """(n, z) Derivatives of the residuals."""
        self.evaluate(z)
        x = self.whole(z)
        columns = self.a * self.baselines.project(self.problem.law_slopes(x, self.forces, self.moves)[:, self.free])
        if self.problem.rises:
            sizes = x[self.last :].copy()
            sizes[~self.held] = self.baselines.sizes(self.measured - self.a * self.raw)
            columns += self.baselines.project(self.problem.column_slopes(x, sizes)[:, self.free])
        if self.scaled and self.square > 0.0:
            columns -= np.outer(self.g, (self.g @ columns) / self.square)
        return np.nan_to_num(columns, posinf=0.0, neginf=0.0)

    def solve(self) -> tuple[np.ndarray, np.ndarray] | None:
        """All unknowns at the minimum, with baselines that may lie beyond their bounds, and the residuals (n,); None
        without a positive scale."""
        begin = self.x[self.free]
        with np.errstate(all="ignore"):
            z = minimize_squares(self.residuals, self.jacobian, begin, self.low, self.high)
            residuals = self.residuals(z)
        if not (self.a > 0.0 and abs(residuals).max() < REJECTED):
            return None
        out = self.x.copy()
        out[self.free] = z
        if self.scaled:
            out[0] += math.log(self.a)
        out[self.loose] = self.baselines.sizes(self.measured - self.a * self.raw)
        return out, residuals


def solve(problem: Problem, x: np.ndarray, fixed: int = -1) -> tuple[np.ndarray, float] | None:
    """The minimum that the search reaches from x, and its sum of squares; `fixed` is an unknown that stays. None: the
    method does not find one within the bounds."""
    low, high = problem.bounds
    last = len(x) - len(problem.baselines)
    held, x = np.zeros(len(problem.baselines), bool), x.copy()
    for _ in range(len(held) + 1):
        found = _Search(problem, x, fixed, held).solve()
        if found is None:
            return None
        out, residuals = found
        beyond = np.maximum(low - out, out - high)[last:]
        if not (beyond > 0.0).any():
            break
        # hold the baseline that is farthest beyond its bound there
        worst = int(np.argmax(beyond))
        held[worst] = True
        x = np.clip(out, low, high)
    # a baseline that is held must not reduce the squares by a return from its bound
    slopes = problem.columns(out)[:, held].T @ residuals
    upper = out[last:][held] > 0.0
    if (np.where(upper, slopes, -slopes) > 0.0).any() or not (low[0] <= out[0] <= high[0]):
        return None
    return out, float(residuals @ residuals)
