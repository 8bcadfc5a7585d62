"""Statistics of residuals in order: how many count as independent, and how many runs of one sign they have."""

import math
from collections.abc import Sequence

import numpy as np


def inflation(residuals: Sequence[np.ndarray], parameters: int) -> float:
    """tau >= 1 of residuals in order, press by press."""
    taus = []
    for r in residuals:
        n = len(r)
        own = max(parameters // len(residuals), 1)
        size = float(r @ r)
        if n < 8 or size == 0.0:
            continue
        rho = np.array([float(r[k:] @ r[: n - k]) / size for k in range(1, n // 3)])
        first = min(rho[0] + (1.0 + 3.0 * rho[0] + own) / n, 0.995)
        summed = 1.0
        for k, value in enumerate(rho, 1):  # until the first that is noise
            value += (1.0 + own) / n
            if value < 2.0 / math.sqrt(n) * (0.5 if k > 1 else 1.0):
                break
            summed += 2.0 * value
        taus.append(max(summed, (1.0 + first) / (1.0 - first) if first > 2.0 / math.sqrt(n) else 1.0))
    return max(float(np.mean(taus)), 1.0) if taus else 1.0


def inflation_limit(residuals: Sequence[np.ndarray], parameters: int) -> float:
    """tau with a first autocorrelation three standard errors above that found: what a short record cannot exclude."""
    at = inflation(residuals, parameters)
    first, rows = (at - 1.0) / (at + 1.0), sum(map(len, residuals))
    above = min(first + 3.0 * math.sqrt((1.0 - first**2) / rows), 0.999)
    return max(at, (1.0 + above) / (1.0 - above))


def runs(residuals: Sequence[np.ndarray]) -> float:
    """How many standard deviations fewer runs of one sign there are than in independent residuals (Wald, Wolfowitz)."""
    signs = np.concatenate([np.sign(r) for r in residuals])
    signs = signs[signs != 0]
    up, n = int((signs > 0).sum()), len(signs)
    down = n - up
    if not up or not down or n < 10:
        return math.inf
    mean = 2.0 * up * down / n + 1.0
    spread = math.sqrt((mean - 1.0) * (mean - 2.0) / (n - 1.0))
    return (mean - 1.0 - int((np.diff(signs) != 0).sum())) / max(spread, 1e-12)
