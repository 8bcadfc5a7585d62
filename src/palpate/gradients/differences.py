"""Derivatives from central differences at three steps, with their errors.

The steps are h, h/4 and h/16. With the values F_j^+, F_j^- at x + h_j, x - h_j and F_0 at x:

    D_j = (F_j^+ - F_j^-)/(2 h_j) = F' + c h_j^2 + ...        R_j = (16 D_j+1 - D_j)/15 = F' + O(h_j^4)
    S_j = F_j^+ + F_j^- - 2 F_0 = F'' h_j^2 + ...             eta = Q |S_3 - S_2/16| / (0.2533 sqrt(6))

eta is the noise of F, such as the tolerance of an implicit step; Q is the 20 % quantile, because kinks fill the upper
part. Where the 40 % quantile of the `NEAR` points around a point shows more noise, eta is that of these. Of R_2 and R_1
each point takes the one with the smaller error: the change by its extrapolation, or of the slopes if they do not
converge, plus the noise; that of R_1 is at least its distance from R_2. A kink of F at x, where the derivatives from
both sides differ, leaves |S_j|/h_j constant instead of proportional to h_j.
At a limit of the setting the differences are one-sided, D_j = (F_j - F_0)/h_j, and the powers of h odd as well:
R_j = (4 D_j+1 - D_j)/3, and the last extrapolation (16 R_2 - R_1)/15 is an estimate too.

C. J. F. Ridders, Adv. Eng. Softw. 4 (1982) 75-76, for the extrapolation with its error.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import percentile_filter

RATIO = 4.0
STEPS = np.array([1.0, 1.0 / RATIO, 1.0 / RATIO**2])
"""Steps over the largest."""
STEP = 4e-3
"""[1] Largest step over the scale of a setting."""
FLOOR = 5e-7
"""[1] Change of the result, over its RMS, by a change of a setting by its scale, below which it counts as none."""
NEAR = 21  # Points around a point whose noise may differ from that of all
SIGMA = 4.0  # Standard deviations of the noise that an error includes


class Derivative(NamedTuple):
    """Derivatives (n, ...) with their errors; `settled`: where the steps agree."""

    value: np.ndarray
    error: np.ndarray
    settled: np.ndarray


def central(
    base: np.ndarray, up: np.ndarray, down: np.ndarray, step: float, scale: float, tolerance: float
) -> Derivative:
    """The derivative from F_0 (n, ...), F^+ and F^- (3, n, ...) at the steps `step` * `STEPS`.

    scale      [x]  of the setting
    tolerance  [1]  largest error over the RMS of the derivative
    """
    h = step * STEPS.reshape(-1, *[1] * base.ndim)
    slopes, bends = (up - down) / (2.0 * h), up + down - 2.0 * base
    rest = bends[2] - bends[1] / RATIO**2
    eta = np.maximum(_noise(rest, math.sqrt(6.0)), _noise_near(rest, math.sqrt(6.0)))
    found = _choose(slopes, RATIO**2, eta / math.sqrt(2.0), step)
    # a kink: the derivatives from both sides differ by S/h at every step
    sides = np.abs(bends) / h
    kink = (sides[2] > 0.5 * sides[1]) & (sides[2] > SIGMA * math.sqrt(6.0) * eta / (step * STEPS[2]))
    return _settle(base, found[0], found[1] + np.where(kink, sides[2], 0.0), scale, tolerance)


def one_sided(base: np.ndarray, moved: np.ndarray, step: float, scale: float, tolerance: float) -> Derivative:
    """The derivative at a limit of the setting, from F_0 (n, ...) and F (3, n, ...) at the steps `step` * `STEPS`.

    step  negative at an upper limit
    """
    h = step * STEPS.reshape(-1, *[1] * base.ndim)
    slopes = (moved - base) / h
    # third differences, free of F' and F''
    third = (slopes[2] - slopes[1]) - (slopes[1] - slopes[0]) / RATIO
    eta = _noise(third * abs(step) * STEPS[2], math.sqrt(2.0))
    value, error = _choose(slopes, RATIO, eta * math.sqrt(2.0), abs(step))
    fine, coarse = ((RATIO * slopes[j + 1] - slopes[j]) / (RATIO - 1.0) for j in (1, 0))
    last = (RATIO**2 * fine - coarse) / (RATIO**2 - 1.0)
    rest = 2.0 * np.abs(last - fine) + SIGMA * math.sqrt(2.0) * eta / (abs(step) * STEPS[2])
    better = rest < error
    return _settle(base, np.where(better, last, value), np.where(better, rest, error), scale, tolerance)


def _noise(rest: np.ndarray, factor: float) -> float:
    """Standard deviation of F, from rests that are noise times `factor`; those that are exactly 0 do not count."""
    rest = np.abs(rest[np.isfinite(rest) & (rest != 0.0)])
    return float(np.quantile(rest, 0.2)) / (0.2533 * factor) if rest.size else 0.0


def _noise_near(rest: np.ndarray, factor: float) -> np.ndarray:
    """Standard deviation of F around each point (n, ...), from rests (n, ...) that are noise times `factor`."""
    size = np.where(np.isfinite(rest), np.abs(rest), 0.0)
    return percentile_filter(size, 40, (min(NEAR, len(size)), *[1] * (size.ndim - 1))) / (0.5244 * factor)


def _choose(slopes: np.ndarray, power: float, eta: np.ndarray | float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """The best estimate and its error, from slopes (3, n, ...) whose errors fall by `power` from step to step.

    eta  (n, ...) noise of a slope times its step
    """
    noise = [SIGMA * eta / (step * each) for each in STEPS]
    fine, coarse = ((power * slopes[j + 1] - slopes[j]) / (power - 1.0) for j in (1, 0))
    # an extrapolation is worth its order only where the slopes converge
    first, second = np.abs(slopes[0] - slopes[1]), np.abs(slopes[1] - slopes[2])
    converging = second <= 4.0 / power * first + noise[2]
    error = np.where(converging, np.abs(fine - slopes[2]), second) + noise[2]
    other = np.where(converging, np.abs(coarse - slopes[1]), first) + noise[1]
    # steps that agree by chance do not agree with the finest
    other = np.maximum(other, np.abs(coarse - fine))
    better = other < error
    return np.where(better, coarse, fine), np.where(better, other, error)


def _settle(base: np.ndarray, value: np.ndarray, error: np.ndarray, scale: float, tolerance: float) -> Derivative:
    """Mark where the error is small over the RMS of the derivative, or the change of the result over its RMS."""
    good = np.isfinite(error) & (error <= 0.1 * np.abs(value))
    size = math.sqrt(float(np.mean(np.where(good, value, 0.0) ** 2)))
    finite = base[np.isfinite(base)]
    floor = FLOOR * math.sqrt(float(np.mean(finite**2))) / scale if finite.size else 0.0
    return Derivative(value, error, error <= max(tolerance * size, floor))
