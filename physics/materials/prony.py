"""Prony series: stress relaxation in quasi-linear viscoelasticity (QLV).

    g(t) = 1 - sum_i g_i (1 - exp(-t/tau_i)),    stress(t) = integral of g(t - s) d(elastic stress)(s)

The elastic law is the instantaneous one with shear modulus G(0); the long-term modulus is G(0) (1 - sum g_i).

Y. C. Fung, Biomechanics: Mechanical Properties of Living Tissues (1993), 7.6; R. L. Taylor, K. S. Pister, G. L.
Goudreau, Int. J. Numer. Methods Eng. 2 (1970) 45-59 for the recursion.
"""

from collections.abc import Sequence

import numpy as np

from palpate.physics.kernel import kernel
from palpate.physics.materials.hyperelastic import MaterialError


@kernel
def _relaxed(shares, times, time, elastic):
    out = np.empty(len(elastic))
    history = shares * elastic[0]
    out[0] = elastic[0]
    still = 1.0 - np.sum(shares)
    for k in range(1, len(elastic)):
        total = still * elastic[k]
        for i in range(len(shares)):
            x = (time[k] - time[k - 1]) / times[i]
            fresh = -np.expm1(-x) / x if x > 1e-9 else 1.0
            history[i] = np.exp(-x) * history[i] + shares[i] * fresh * (elastic[k] - elastic[k - 1])
            total += history[i]
        out[k] = total
    return out


class Prony:
    """Shares g_i [1] (k,) that relax and their times tau_i [s] (k,).

    MaterialError: shares that are negative or sum to 1 or more, times that are not positive.
    """

    def __init__(self, shares: Sequence[float] | np.ndarray, times: Sequence[float] | np.ndarray) -> None:
        self.shares, self.times = np.atleast_1d(np.array(shares, float)), np.atleast_1d(np.array(times, float))
        if self.shares.shape != self.times.shape or self.shares.ndim != 1:
            raise MaterialError(f"Prony series: {self.shares.size} shares, {self.times.size} times; expected as many")
        if not (self.shares >= 0).all() or not self.shares.sum() < 1.0:
            raise MaterialError(f"Prony shares {self.shares.tolist()}: expected numbers >= 0 whose sum is below 1")
        if not (np.isfinite(self.times).all() and (self.times > 0).all()):
            raise MaterialError(f"Prony times {self.times.tolist()} s: expected positive numbers")

    def relaxed(self, time: np.ndarray, elastic: np.ndarray) -> np.ndarray:
        """The relaxed response (n,) to an elastic response (n,) at increasing times [s] (n,), which is piecewise linear
        and starts from rest with a jump at the first time."""
        time, elastic = np.ascontiguousarray(time, float), np.ascontiguousarray(elastic, float)
        return _relaxed(self.shares, self.times, time, elastic)
