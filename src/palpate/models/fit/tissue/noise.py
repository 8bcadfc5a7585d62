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
LEAST_DITHER = 20  # Least rows at small forces that show the noise before a converter


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


def quantised_variance(rows: np.ndarray, force: np.ndarray, step: float, noise: float, averaged: int = 1) -> np.ndarray:
    """Variance (k,) of the sums of `rows` (k, n) times the errors [N] of a converter at these forces (n,) [N].

    A harmonic may alias with the sampling: each takes the mean variance over steps within `BEAT` of this one, because
    the fitted forces are not exact.

    averaged  rows of the file that each row is the mean of: the part that noise decorrelates is smaller by this factor
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
        out += power * (np.abs(rows @ waves) ** 2).mean(axis=1)
        left -= power
    return step**2 * (out + max(left, 0.0) / averaged * np.sum(rows**2, axis=1))


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


def dither(residual: np.ndarray, force: np.ndarray, step: float, averaged: int = 1) -> float:
    """Noise [N] before the converter, from the second differences of the residuals (n,).

    They have the expected square 6 s² + sum_k c_k (1 - exp(-(2 pi k s/q)²)) of the errors of a converter at the fitted
    forces (n,), which grows with s. Before contact, where the errors matter most, these rows alone are compared if
    they suffice: noise may grow with the force.
    """
    small = np.abs(force - force[0]) < 0.1 * np.ptp(force)
    first = np.flatnonzero(small[:-2] & small[1:-1] & small[2:])
    if len(first) < LEAST_DITHER:
        first = np.arange(len(force) - 2)
    seen = float(np.mean((residual[first] - 2.0 * residual[first + 1] + residual[first + 2]) ** 2)) * averaged
    most = math.sqrt(seen / 6.0)
    sizes = most * np.linspace(0.0, 1.0, 201)
    one, two = force[first + 1] - force[first], force[first + 2] - force[first + 1]
    expected = 6.0 * sizes**2 + 0.5 * step**2
    for k in HARMONICS:
        turn = 2.0 * math.pi * k / step
        c = float(np.mean(4.0 * np.cos(turn * one) + 4.0 * np.cos(turn * two) - 2.0 * np.cos(turn * (one + two))))
        expected -= step**2 * c / (2.0 * math.pi**2 * k**2) * np.exp(-((turn * sizes) ** 2))
    return float(sizes[int(np.argmax(expected >= seen))]) if (expected >= seen).any() else most


def sandwich(influence: np.ndarray, blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Covariance (p, p) of the unknowns, which change by `influence` (p, n) with the weighted forces, with the
    covariances of these in each press."""
    at, out = 0, np.zeros((len(influence), len(influence)))
    for block in blocks:
        part = influence[:, at : at + len(block)]
        out += part @ block @ part.T
        at += len(block)
    return out
