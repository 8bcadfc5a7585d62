"""Autoregressive models of a vibration and their line spectral frequencies.

    y_t = g e_t - sum_j a_j y_{t-j},    A(z) = 1 + sum_j a_j z^-j,    e_t white noise of variance 1

The line spectral frequencies (LSF) are the angles in (0, pi) of the roots of A(z) +- z^-(p+1) A(1/z). They interlace if
all roots of A are inside the unit circle, and any p increasing angles give a stable A; so a weighted mean of the LSF of
stable models is stable (F. Itakura, JASA 57 (1975) S35; F. K. Soong, B.-H. Juang, IEEE ICASSP 1984, 37-40). Texture as
AR models over force and speed: H. Culbertson, J. Unwin, K. J. Kuchenbecker, IEEE Trans. Haptics 7 (2014) 381-393.
"""

import math

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.device.random_numbers import uniform


def line_spectrum(a: np.ndarray) -> np.ndarray:
    """LSF [rad] (p), increasing, of a (p). ValueError: an unstable model."""
    whole = np.concatenate([[1.0], a, [0.0]])
    roots = np.concatenate([np.roots(whole + whole[::-1]), np.roots(whole - whole[::-1])])
    angles = np.sort(np.angle(roots))
    angles = angles[(angles > 1e-9) & (angles < np.pi - 1e-9)]
    if len(angles) != len(a) or np.any(np.abs(np.abs(roots) - 1.0) > 1e-4):
        raise ValueError("an unstable autoregressive model")
    return angles


@kernel(error_model="numpy")
def coefficients(lsf, p, q, a):
    """Fill a (n) from LSF [rad] (n); p and q (n + 2) are workspace."""
    n = len(lsf)
    p[:], q[:] = 0.0, 0.0
    p[0] = q[0] = 1.0
    for i in range(n):  # the first, third, ... are roots of the sum
        poly, c = (p, -2.0 * math.cos(lsf[i])) if i % 2 == 0 else (q, -2.0 * math.cos(lsf[i]))
        for j in range(i // 2 * 2 + 2, 0, -1):
            poly[j] += c * poly[j - 1] + (poly[j - 2] if j > 1 else 0.0)
    if n % 2 == 0:  # the roots at -1 and 1
        for j in range(n + 1, 0, -1):
            p[j] += p[j - 1]
            q[j] -= q[j - 1]
    else:
        for j in range(n + 1, 1, -1):
            q[j] -= q[j - 2]
    for j in range(n):
        a[j] = 0.5 * (p[j + 1] + q[j + 1])


@kernel(error_model="numpy")
def innovation(a, work):
    """Gain g [1] for which the process a (n) has variance 1: g^2 = prod (1 - k_j^2) with its reflection coefficients
    k_j; work (n) is workspace."""
    power = 1.0
    for j in range(len(a)):
        work[j] = a[j]
    for m in range(len(a) - 1, -1, -1):
        k = work[m]
        power *= max(1.0 - k * k, 0.0)
        if not power > 0.0:
            return 0.0
        for j in range((m + 1) // 2):
            low, high = work[j], work[m - 1 - j]
            work[j] = (low - k * high) / (1.0 - k * k)
            work[m - 1 - j] = (high - k * low) / (1.0 - k * k)
    return math.sqrt(power)


@kernel(error_model="numpy")
def filter_sample(a, gain, past, newest, random):
    """The next sample, and its index in the ring buffer `past` (n); random: state of `random_numbers`. Normal noise:
    G. E. P. Box, M. E. Muller, Ann. Math. Stat. 29 (1958) 610-611."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(random)))
    n, y = len(a), gain * radius * math.cos(2.0 * math.pi * uniform(random))
    for j in range(n):
        y -= a[j] * past[(newest - j) % n]
    newest = (newest + 1) % n
    past[newest] = y
    return y, newest


def yule_walker(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Levinson's recursion for autocovariances (p + 1): a (p), and the residual variance of each order (p + 1)."""
    a, residual = np.zeros(0), [covariance[0]]
    for m in range(1, len(covariance)):
        k = -(covariance[m] + a @ covariance[m - 1 : 0 : -1]) / residual[-1]
        a = np.concatenate([a + k * a[::-1], [k]])
        residual.append(residual[-1] * (1.0 - k * k))
    return a, np.array(residual)


def spectrum(lsf: np.ndarray, rms: float, sampling: float, frequency: np.ndarray) -> np.ndarray:
    """One-sided power spectral density (n) at frequencies [Hz] (n) of a model."""
    a, p, q = np.zeros(len(lsf)), np.zeros(len(lsf) + 2), np.zeros(len(lsf) + 2)
    coefficients(lsf, p, q, a)
    gain = rms * innovation(a, np.zeros(len(lsf)))
    turn = np.exp(-2j * np.pi * np.outer(frequency / sampling, np.arange(1, len(a) + 1)))
    return 2.0 * gain**2 / sampling / np.abs(1.0 + turn @ a) ** 2
