"""Statistics of serially correlated residuals: effective number, likely correlations, runs test, lack-of-fit test."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.stats import f as f_distribution

CORRELATIONS = np.tanh(np.linspace(0.0, 3.5, 36))  # [1] Autocorrelations at lag 1 over which `lack_of_fit` averages


def inflation(residuals: Sequence[np.ndarray], parameters: int) -> float:
    """Autocorrelation time tau >= 1 of the residuals of presses, corrected for its bias in short records (F. H. C.
    Marriott, J. A. Pope, Biometrika 41 (1954) 390-402)."""
    taus = []
    for r in residuals:
        n = len(r)
        fitted = max(parameters // len(residuals), 1)
        size = float(r @ r)
        if n < 8 or size == 0.0:
            continue
        summed, first = 1.0, 0.0
        for k in range(1, n // 3):  # up to the first insignificant one
            value = float(r[k:] @ r[: n - k]) / size
            if k == 1:
                first = min(value + (1.0 + 3.0 * value + fitted) / n, 0.995)
            value += (1.0 + fitted) / n
            if value < 2.0 / math.sqrt(n) * (0.5 if k > 1 else 1.0):
                break
            summed += 2.0 * value
        taus.append(max(summed, (1.0 + first) / (1.0 - first) if first > 2.0 / math.sqrt(n) else 1.0))
    return max(float(np.mean(taus)), 1.0) if taus else 1.0


def lack_of_fit(
    residuals: Sequence[np.ndarray], jacobian: np.ndarray, groups: Mapping[str, np.ndarray], least: float
) -> dict[str, float]:
    """p-value of each group of columns (n, k) as an explanation of the residuals of a fit.

    The noise of each press is autoregressive, e_i = rho e_(i-1) + white. For each rho, residuals and columns are
    whitened, and an F-test compares the fit with the group to the fit alone,

        F = (S_fit - S_group)/k / (S_all/(n - p_all)),

    with S the residual sum of squares; that of all groups together measures the noise. The p-value is the mean over
    rho, weighted with its restricted likelihood (H. D. Patterson, R. Thompson, Biometrika 58 (1971) 545-554).

    jacobian  (n, p) of the fit
    least     RMS that a group must explain; the p-value is 1 if it explains less
    """
    begins = np.cumsum([0, *map(len, residuals[:-1])])
    r, every = np.concatenate(residuals), np.column_stack([jacobian, *groups.values()])
    n, free = len(r), len(r) - every.shape[1]
    chances = dict.fromkeys(groups, 1.0)
    if free < every.shape[1]:
        return chances
    alone, _ = _residual_squares(jacobian, r, begins)(CORRELATIONS)
    logs, variances = correlation_likelihoods(r, every, begins)
    weights, white = np.exp(logs - logs.max()), variances * (1.0 - CORRELATIONS**2)
    for name, columns in groups.items():
        both, k = _residual_squares(np.column_stack([jacobian, columns]), r, begins), columns.shape[1]
        squares, _ = both(CORRELATIONS)
        if alone[0] - squares[0] > n * least**2:  # without correlation
            ratios = (alone - squares) / k / white
            chances[name] = float(weights @ f_distribution.sf(ratios, k, free) / weights.sum())
    return chances


def correlation_likelihoods(r: np.ndarray, jacobian: np.ndarray, begins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of the restricted likelihoods of `CORRELATIONS` rho of autoregressive noise e_i = rho e_(i-1) + white,
    up to a constant, with the weight of their spacing; and the variances of e that the residuals r (n,) of a fit with
    this Jacobian (n, p) then show: the squares of the whitened residuals over n - p, over 1 - rho².

    begins  rows that do not depend on the one before
    """
    free = max(len(r) - jacobian.shape[1], 1)
    left, size = _residual_squares(jacobian, r, begins)(CORRELATIONS)
    left, fresh = np.maximum(left, 1e-300), 1.0 - CORRELATIONS**2
    logs = 0.5 * (len(begins) * np.log(fresh) - size - free * np.log(left)) + np.log(fresh)
    return logs, left / free / fresh


def _residual_squares(
    columns: np.ndarray, r: np.ndarray, begins: np.ndarray
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Correlations (m,) -> residual sums of squares of the whitened r (n,) on the whitened columns (n, p), and the
    logarithms of the determinants of their Gram matrices, up to a constant."""
    basis, sizes, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False)
    table = np.column_stack([basis[:, sizes > 1e-9 * sizes[0]], r])
    later = np.setdiff1d(np.arange(len(r)), begins)
    first, now, before = table[begins], table[later], table[later - 1]
    parts = first.T @ first, now.T @ now, now.T @ before + before.T @ now, before.T @ before

    def at(correlations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rho = correlations[:, None, None]
        gram = (1.0 - rho**2) * parts[0] + parts[1] - rho * parts[2] + rho**2 * parts[3]
        inner, across = gram[:, :-1, :-1], gram[:, :-1, -1:]
        explained = np.sum(across * np.linalg.solve(inner, across), axis=(1, 2))
        return gram[:, -1, -1] - explained, np.linalg.slogdet(inner)[1]

    return at


def runs(residuals: Sequence[np.ndarray]) -> float:
    """Runs test (Wald, Wolfowitz): standard deviations by which the residuals have too few runs of one sign."""
    signs = np.concatenate([np.sign(r) for r in residuals])
    signs = signs[signs != 0]
    up, n = int((signs > 0).sum()), len(signs)
    down = n - up
    if not up or not down or n < 10:
        return math.inf
    mean = 2.0 * up * down / n + 1.0
    spread = math.sqrt((mean - 1.0) * (mean - 2.0) / (n - 1.0))
    return (mean - 1.0 - int((np.diff(signs) != 0).sum())) / max(spread, 1e-12)
