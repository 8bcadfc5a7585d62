"""Prony series: stress relaxation in quasi-linear viscoelasticity (QLV).

    g(t) = 1 - sum_i g_i (1 - exp(-t/tau_i)),    stress(t) = integral of g(t - s) d(elastic stress)(s)

The elastic law is the instantaneous one with shear modulus G(0); the long-term modulus is G(0) (1 - sum g_i).

Y. C. Fung, Biomechanics: Mechanical Properties of Living Tissues (1993), 7.6; R. L. Taylor, K. S. Pister, G. L.
Goudreau, Int. J. Numer. Methods Eng. 2 (1970) 45-59 for the recursion.
"""

from collections.abc import Sequence

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array
from palpate.physics.materials.hyperelastic import MaterialError


@kernel
def _relaxed_kernel(shares: Array, times: Array, time: Array, elastic: Array):
    out = np.empty(len(elastic))
    history = shares * elastic[0]
    out[0] = elastic[0]
    still = 1.0 - np.sum(shares)
    for k in range(1, len(elastic)):
        total = still * elastic[k]
        for i in range(len(shares)):
            x = (time[k] - time[k - 1]) / times[i]
            lost = -np.expm1(-x)  # 1 - exp(-x)
            fresh = lost / x if x > 1e-9 else 1.0
            history[i] = (1.0 - lost) * history[i] + shares[i] * fresh * (elastic[k] - elastic[k - 1])
            total += history[i]
        out[k] = total
    return out


@kernel
def _slopes_kernel(shares: Array, times: Array, time: Array, elastic: Array):
    count = len(shares)
    out = np.empty((len(elastic), 2 * count))
    history, turn = np.full(count, elastic[0]), np.zeros(count)  # h_i and its derivative by ln tau_i
    for k in range(len(elastic)):
        for i in range(count):
            if k > 0:
                x = (time[k] - time[k - 1]) / times[i]
                lost = -np.expm1(-x)
                fresh, decay, change = lost / x if x > 1e-9 else 1.0, 1.0 - lost, elastic[k] - elastic[k - 1]
                turn[i] = decay * (x * history[i] + turn[i]) + (fresh - decay) * change
                history[i] = decay * history[i] + fresh * change
            out[k, 2 * i] = history[i] - elastic[k]
            out[k, 2 * i + 1] = shares[i] * turn[i]
    return out


def relaxed_slopes(shares: np.ndarray, times: np.ndarray, time: np.ndarray, elastic: np.ndarray) -> np.ndarray:
    """(n, 2 k) Derivatives of `relax_response` by each share, and by the logarithm of its time.

    With the part h_i of a term of share 1, h_i' = F_e' - h_i/tau_i, the response is F_e + sum_i g_i (h_i - F_e). Over a
    step x = dt/tau_i in which F_e changes by dF, h = e^-x h + f dF, f = (1 - e^-x)/x, so that

        dh/d(ln tau) = e^-x (x h + dh/d(ln tau)) + (f - e^-x) dF.
    """
    return _slopes_kernel(
        np.ascontiguousarray(shares, float), np.ascontiguousarray(times, float), np.ascontiguousarray(time, float),
        np.ascontiguousarray(elastic, float),
    )  # fmt: skip


def relax_response(
    shares: Sequence[float] | np.ndarray, times: Sequence[float] | np.ndarray, time: np.ndarray, elastic: np.ndarray
) -> np.ndarray:
    """The relaxed response (n,) to an elastic response (n,) at increasing times [s] (n,), which is piecewise linear and
    starts from rest with a jump at the first time.

    shares  [1] (k,) g_i, which relax with the times tau_i [s] (k,)

    MaterialError: shares that are negative or sum to 1 or more, times that are not positive.
    """
    g, tau = np.array(shares, float), np.array(times, float)
    if g.shape != tau.shape or g.ndim != 1:
        raise MaterialError(f"Prony series: {g.size} shares, {tau.size} times; expected equal numbers")
    if not (g >= 0).all() or not g.sum() < 1.0:
        raise MaterialError(f"Prony shares {g.tolist()}: expected numbers >= 0 whose sum is below 1")
    if not (np.isfinite(tau).all() and (tau > 0).all()):
        raise MaterialError(f"Prony times {tau.tolist()} s: expected positive numbers")
    return _relaxed_kernel(g, tau, np.ascontiguousarray(time, float), np.ascontiguousarray(elastic, float))
