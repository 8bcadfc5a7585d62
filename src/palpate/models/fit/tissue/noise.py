"""Noise of force sensors that is not white: quantisation, gain noise.

Quantisation. A converter with the step q rounds the force F: its error is a sawtooth of F. For a zero that lies
anywhere in a step, the errors of two rows with forces F_i, F_j have the covariance

    C_ij = q² sum_k cos(2 pi k (F_i - F_j)/q)/(2 pi² k²) exp(-(2 pi k s/q)²),   the last factor for i != j only,

with noise s before the converter, which decorrelates the errors (B. Widrow, I. Kollár, Quantization Noise (2008)).
Without noise all rows before contact have the same error, which does not average out.

Gain noise. The error grows with the force: its standard deviation is sqrt(a² + b² F²), and its correlation that of the
residuals in contact.
"""

import math
from collections.abc import Sequence

import numpy as np

from palpate.models.fit.tissue.residuals import inflation

ON_GRID = 0.05  # [1] Largest distance of a value from the grid, in steps, of a quantised force
MOST_LEVELS = 0.5  # [1] Most levels, over the number of rows, of a force whose step is found
GAIN = 2.0  # [1] Ratio of the variances in the upper and the lower part of the force above which the noise has a gain
SURE_ROWS, MOST_RHO = 30, 0.9  # Rows from which on their correlation is estimated well [1], and its limit below
LEAST_GAIN = 6  # Least rows in contact, and before it, whose residuals are compared
BEAT = 0.01  # [1] Relative uncertainty of the fitted forces
HARMONICS = np.arange(1, 9)


def step_of(force: np.ndarray) -> float:
    """Step q [N] of the converter, from repeated values of the force (n,); 0 if they do not lie on a grid."""
    levels = np.unique(force)
    if len(levels) < 3 or len(levels) > MOST_LEVELS * len(force):
        return 0.0
    apart = np.diff(levels)
    apart = apart[apart > 1e-6 * np.ptp(levels)]  # of the conversion of units
    step = float(apart.min()) if len(apart) else 0.0
    if step <= 0.0:
        return 0.0
    steps = apart / step
    step = float(apart.sum() / np.round(steps).sum())
    return step if float(np.abs(apart / step - np.round(steps)).max()) < ON_GRID else 0.0


def quantised_variance(rows: np.ndarray, force: np.ndarray, step: float, noise: float) -> np.ndarray:
    """Variance (k,) of the sums of `rows` (k, n) times the errors [N] of a converter at these forces (n,) [N].

    A harmonic may alias with the sampling: each takes the largest variance for steps within `BEAT` of this one, because
    the fitted forces are not exact.
    """
    out = np.zeros(len(rows))
    scales = np.linspace(1.0 - BEAT, 1.0 + BEAT, 41)
    left = 1.0 / 12.0
    first = waves = np.exp(2j * math.pi / step * force[:, None] * scales)
    for k in HARMONICS:
        power = 1.0 / (2.0 * math.pi**2 * k**2) * math.exp(-((2.0 * math.pi * k * noise / step) ** 2))
        if power < 1e-6:
            break
        waves = first if k == 1 else waves * first
        out += power * (np.abs(rows @ waves) ** 2).max(axis=1)
        left -= power
    return step**2 * (out + max(left, 0.0) * np.sum(rows**2, axis=1))


def gain(force: np.ndarray, residual: np.ndarray, unknowns: int) -> tuple[np.ndarray, float] | None:
    """Covariance (n, n) of residuals (n,) whose size grows with the force, and the number of independent ones that
    show this size, those in contact.

    None: the size does not grow with the force.
    """
    large, small = in_contact(force), force < 0.1 * force.max()
    if min(large.sum(), small.sum()) < LEAST_GAIN:
        return None
    # a fit follows its few rows in contact, where the residuals are then smaller than the noise
    share = max(1.0 - min(unknowns, 3) / large.sum(), 0.3)
    upper, lower = float(np.mean(residual[large] ** 2)) / share, float(np.mean(residual[small] ** 2))
    if upper < GAIN * lower:
        return None
    b = (upper - lower) / float(np.mean(force[large] ** 2))
    size = np.sqrt(lower + b * np.maximum(force, 0.0) ** 2)
    size = np.maximum(size, 1e-3 * size.max())  # rows that do not count have no residual
    scaled = (residual / size)[large]
    tau = inflation([scaled], unknowns)
    rho = (tau - 1.0) / (tau + 1.0)
    if large.sum() < SURE_ROWS:  # too short to show a correlation: one standard error more
        rho = min(rho + 1.0 / math.sqrt(large.sum()), MOST_RHO)
        tau = (1.0 + rho) / (1.0 - rho)
    n = len(force)
    # restricted maximum likelihood would divide by the number of independent rows less the unknowns
    few = max(large.sum() / tau, unknowns + 2.0)
    lag = np.abs(np.arange(n)[:, None] - np.arange(n)[None, :])
    return size[:, None] * size[None, :] * rho**lag * few / (few - unknowns), few


def in_contact(force: np.ndarray) -> np.ndarray:
    """(n,) The rows that show noise which grows with the force (n,) of the law."""
    return force > 0.3 * force.max()


def noise_before(force: np.ndarray) -> float:
    """Standard deviation of white noise [N] from the second differences (n,)."""
    return float(np.median(np.abs(np.diff(force, 2)))) / 0.6745 / math.sqrt(6.0)


def dither(force: np.ndarray, step: float) -> float:
    """Lower bound of the noise [N] before the converter: rounding adds at most q²/4 to the variance."""
    return math.sqrt(max(float(np.mean(np.diff(force, 2) ** 2)) / 6.0 - 0.25 * step**2, 0.0))


def sandwich(J: np.ndarray, bread: np.ndarray, blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Covariance (p, p) of the unknowns of a least-squares fit, (J'J)^-1 J' C J (J'J)^-1, with C block-diagonal."""
    at, middle = 0, np.zeros_like(bread)
    for block in blocks:
        part = J[at : at + len(block)]
        middle += part.T @ block @ part
        at += len(block)
    return bread @ middle @ bread
