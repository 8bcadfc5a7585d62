"""Intervals of the profile likelihood of a fit to recordings, whose points are computed together.

The end of parameter i is where the least sum of squares over all others has risen as much as the linear model says of
its end. Each round minimizes the others with the Jacobian at the minimum, or at the end itself where the rise is not
that of the linear model, and scales the distance by the square root of the rise.
"""

import math

import numpy as np
from scipy.stats import t as student

from palpate.models.fit.tissue.estimate import LEVEL, Estimate
from palpate.studies.inverse.descent import Point
from palpate.studies.inverse.problem import RunProblem

WIDEST = math.log(3.0)
"""[1] Half of a 95 % interval, as a logarithm or in scales, above which a parameter is not determined."""
ROUNDS = 6  # corrections of the end of a profile
NO_EFFECT = 1e-3  # [1] Change of the residuals over their size: rounding, not an effect of a parameter
BENT, CLOSE = 0.1, 0.02  # [1] Errors of the distance: the linear model does not hold; the end is found


def widen_to_profiles(problem: RunProblem, fitted: Estimate, best: Point) -> None:
    """Widen the intervals to those of the profile likelihood.

    best  the minimum, with derivatives by central differences
    """
    x, size, slopes = fitted.at, len(fitted.at), best.slopes
    low, high = problem.bounds
    quantile = float(student.ppf(0.5 + LEVEL / 2, fitted.effective[0] - size))
    reach = (problem.priors.quantiles if problem.priors else quantile) * fitted.errors
    unit = np.linalg.norm(slopes, axis=0)
    # derivatives that are rounding would explain a part of the noise
    acts = 2.0 * WIDEST * unit > NO_EFFECT * np.linalg.norm(best.r)
    unit[unit == 0.0] = 1.0
    gram = np.linalg.pinv((slopes / unit).T @ (slopes / unit), rcond=1e-15) / np.outer(unit, unit)
    ends = [(i, side) for i in range(size) for side in (-1.0, 1.0) if 0.0 < reach[i] < WIDEST * 2.0]
    far = np.array([reach[i] for i, _ in ends])
    at = np.array([x + side * reach[i] * gram[:, i] / gram[i, i] for i, side in ends])
    left, bent, there = list(range(len(ends))), set[int](), dict[int, np.ndarray]()  # derivatives at bent ends
    for _ in range(ROUNDS):
        if not left:
            break
        at = np.clip(at, low, high)
        shares = np.ones(len(ends))
        for k, r in zip(left, problem.all_residuals(at[left]), strict=True):
            i, others = ends[k][0], acts & (np.arange(size) != ends[k][0])
            if k in bent and k not in there:
                there[k] = problem.slopes_at(at[k], r, others)
            part = there.get(k, slopes)[:, others]
            step = -np.linalg.lstsq(part, r, rcond=None)[0] if others.any() else np.zeros(0)
            rise = max(float(r @ r) + float((part.T @ r) @ step) - best.squares, 0.0)
            at[k, others] += step
            shares[k] = math.sqrt(rise * gram[i, i]) / reach[i]  # 1 for a linear model
            factor = min(max(1.0 / shares[k] if shares[k] > 0.0 else 2.0, 0.5), 2.0)
            far[k], at[k] = abs(at[k, i] - x[i]) * factor, x + (at[k] - x) * factor
        bent |= set(np.flatnonzero(np.abs(shares - 1.0) > BENT).tolist())
        left = np.flatnonzero(np.abs(shares - 1.0) >= CLOSE).tolist()
    for k, (i, side) in enumerate(ends):
        p = problem.parameters[i]
        end = p.value(min(max(x[i] + side * far[k], low[i]), high[i]))
        interval = fitted.intervals[p.name]
        both = list(interval.profile)
        both[side > 0.0] = end
        interval.profile = (both[0], both[1])
        interval.low, interval.high = min(interval.low, end), max(interval.high, end)
