"""Covariance of the unknowns of a fit by least squares, and the reach of their intervals.

The unknowns follow from the n weighted residuals with the Jacobian J. With the covariance C of the noise,

    cov = (J'J)^-1 J' C J (J'J)^-1,    C_ij = s² w_i w_j rho^|i-j| + Q_ij

w    weights of the rows
rho  correlation of the noise between rows of a press; it is not known, and each value counts with its restricted
     likelihood (`residuals`)
s²   (rho) squares of the whitened residuals of a fit to them over n - p
Q    of the steps of a converter (`noise`), whose part of the residuals does not count for s²

Noise with a correlation of 0.9 changes a mean over many rows by (1 + rho)/(1 - rho) = 19 times more than white noise,
and a modulus of 12 rows in contact by much less: the sum over all rows has both. The error over its standard deviation
follows Student's t with n - p degrees of freedom for each rho, and the interval is that of the mixture.

Noise that grows with the force counts with its covariance (`noise.gain`) if that gives the wider interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.special import ndtri, stdtr, stdtrit

from palpate.models.fit.tissue import noise
from palpate.models.fit.tissue.residuals import CORRELATIONS, correlation_likelihoods, inflation

LEVEL = 0.95
TINY = 1e-200
NEGLIGIBLE = 3e-3  # [1] Likelihood of a noise, over the largest one, below which it does not count
LEAST_EFFECTIVE = 3.0
"""Lower bound of the independent residuals per unknown. A law that misfits leaves fewer, and no statistic then measures
the error of its parameters; the report describes the misfit separately."""


class Problem(Protocol):
    """What the covariance needs of `estimate.Problem`."""

    weight: list[np.ndarray]
    presses: list[Any]

    @property
    def ends(self) -> np.ndarray: ...
    def residual_variance(self, rows: np.ndarray, forces: Sequence[np.ndarray]) -> np.ndarray: ...
    def visible_variance(self, J: np.ndarray, forces: Sequence[np.ndarray]) -> float: ...


def of_unknowns(
    problem: Problem, forces: Sequence[np.ndarray], pressed: Sequence[np.ndarray], residuals: Sequence[np.ndarray],
    J: np.ndarray, influence: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Covariance (p, p) of the unknowns, half the widths (p,) of their intervals, and the number of independent
    residuals.

    forces, pressed  [N] of the fit, and of the law alone: an untared sensor has a large force without contact
    residuals        [N] (n,) of each press
    influence        (p, n) (J'J)^-1 J': changes of the unknowns by the weighted forces
    """
    size, weight = J.shape[1], np.concatenate(problem.weight)
    weighted = weight * np.concatenate(residuals)
    noises = _likely(weighted, weight, J, problem.ends)
    rows = influence * weight
    each = [s2 * rows @ _smoothed(rows, rho, problem.ends).T for _, rho, s2 in noises]
    shares = np.array([share for share, _, _ in noises])
    errors = np.sqrt(np.maximum([np.diag(part) for part in each], 0.0))
    cov = np.einsum("m,mij->ij", shares, each)
    reach = np.array([_reach(shares, column, int(np.count_nonzero(weight)) - size) for column in errors.T])
    effective = max(len(J) / inflation(residuals, size), LEAST_EFFECTIVE * size)
    # steps of the converter instead of their part in the residuals
    known = problem.residual_variance(influence, forces)
    if known.any():
        squares = float(weighted @ weighted)
        share = 1.0 - min(problem.visible_variance(J, forces) / max(squares, TINY), 1.0)
        both = share * np.diag(cov) + known
        reach = np.sqrt(share * reach**2 + float(ndtri(0.5 + LEVEL / 2)) ** 2 * known)
        grow = np.sqrt(both / np.maximum(np.diag(cov), TINY))
        cov = cov * np.outer(grow, grow)
    # noise that grows with the force
    gains = [noise.gain(force, r, size) for force, r in zip(pressed, residuals, strict=True)]
    if all(found is not None for found in gains):
        found = [each for each in gains if each is not None]
        blocks = [block * np.outer(w, w) for (block, _), w in zip(found, problem.weight, strict=True)]
        larger = noise.sandwich(influence, blocks)
        few = sum(count for _, count in found)
        effective = max(min(effective, few), LEAST_EFFECTIVE * size)
        errors = np.sqrt(np.maximum(np.diag(larger), 0.0))
        grow = np.maximum(errors / np.sqrt(np.maximum(np.diag(cov), TINY)), 1.0)
        cov = cov * np.outer(grow, grow)
        reach = np.maximum(reach, float(stdtrit(effective - size, 0.5 + LEVEL / 2)) * errors)
    return cov, reach, effective


def _likely(
    weighted: np.ndarray, weight: np.ndarray, J: np.ndarray, ends: np.ndarray
) -> list[tuple[float, float, float]]:
    """Share of the likelihood, rho and s² of each noise that the weighted residuals do not exclude."""
    kept = weight > 0.0
    begins = np.searchsorted(np.flatnonzero(kept), ends[:-1])
    logs, variances = correlation_likelihoods(
        weighted[kept] / weight[kept], J[kept] / weight[kept, None], begins
    )  # fmt: skip
    shares = np.exp(logs - logs.max())
    likely = shares > NEGLIGIBLE
    shares = shares[likely] / shares[likely].sum()
    return list(zip(shares.tolist(), CORRELATIONS[likely].tolist(), variances[likely].tolist(), strict=True))


def _smoothed(rows: np.ndarray, rho: float, ends: np.ndarray) -> np.ndarray:
    """(k, n) rows R, with R_ij = rho^|i-j| within each press: a recursion in each direction."""
    out = -rows
    for a, b in pairwise(ends):
        part = rows[:, a:b]
        out[:, a:b] += lfilter([1.0], [1.0, -rho], part)
        out[:, a:b] += lfilter([1.0], [1.0, -rho], part[:, ::-1])[:, ::-1]
    return out


def _reach(weights: np.ndarray, errors: np.ndarray, free: int) -> float:
    """The value that the absolute error exceeds with the probability 1 - `LEVEL`: a mixture (m,) of Student's t with
    these standard errors."""
    largest, kept = float(errors.max()), errors > 0.0
    if not 0.0 < largest < math.inf:
        return largest
    quantile = float(stdtrit(free, 0.5 + LEVEL / 2))
    if len(errors) == 1:
        return quantile * largest

    def beyond(x: float) -> float:
        return 2.0 * float(weights[kept] @ stdtr(free, -x / errors[kept])) - (1.0 - LEVEL)

    low, high = quantile * float(errors[kept].min()), quantile * largest
    return high if beyond(low) <= 0.0 or high <= low else float(brentq(beyond, low, high * (1.0 + 1e-9), rtol=1e-4))
