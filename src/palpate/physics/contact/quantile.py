"""Survival functions and quantiles of the normal law and of Student's t, in kernels: the same bits on all processors.

Both functions are relative to zero mean and unit scale; `freedom` 0 is the normal law. Relative error of a probability
and of a quantile: below 1e-13 for `freedom` up to 100, 1e-10 up to 1e6.
"""

import math

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array

ROOT_PI, ROOT_2_PI = math.sqrt(math.pi), math.sqrt(2.0 * math.pi)
FAR = 2.0  # Beyond this number of deviations the normal law uses the continued fraction, as its digits cancel
FRACTION = 80  # Terms of this fraction, whose error is exp(-2 sqrt(2) z sqrt(terms))
MOST = 20_000  # Terms of the fraction of the incomplete beta function: at most about 5 sqrt(freedom)
ENOUGH = 1e-16  # [1] Relative change at which an iteration ends
STEPS = 200  # Of the search for a quantile, which takes about 6


@kernel
def _normal_tail(z: float):
    """log S(z) and the hazard rate -d log S/dz of the normal law, z >= 0 (M. Abramowitz, I. A. Stegun, 1964, 26.2.10
    and 26.2.14)."""
    if z > FAR:
        hazard = z
        for k in range(FRACTION, 0, -1):
            hazard = z + k / hazard
        return -0.5 * z * z - math.log(ROOT_2_PI * hazard), hazard
    density = math.exp(-0.5 * z * z) / ROOT_2_PI
    term = total = z
    k = 1
    while term > ENOUGH * total:
        k += 2
        term *= z * z / k
        total += term
    tail = 0.5 - density * total
    return math.log(tail), density / tail


@kernel
def _fraction(a: float, b: float, x: float):
    """The continued fraction of the incomplete beta function (Abramowitz and Stegun 26.5.8), by the method of W. J.
    Lentz (Appl. Opt. 15 (1976) 668-671)."""
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    value = d
    for m in range(1, MOST):
        even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        value *= d * c
        odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        value *= d * c
        if abs(d * c - 1.0) <= ENOUGH:
            break
    return value


@kernel
def _gamma_ratio(a: float):
    """log(Gamma(a + 1/2)/Gamma(a)), a > 0: its asymptotic series above 30."""
    product = 1.0
    while a < 30.0:
        product *= a / (a + 0.5)
        a += 1.0
    u = 1.0 / (a * a)
    series = (-0.125 + u * (1.0 / 192.0 + u * (-1.0 / 640.0 + u * (17.0 / 14336.0)))) / a
    return math.log(product) + 0.5 * math.log(a) + series


@kernel
def _student_tail(z: float, freedom: float):
    """log S(z) and the hazard rate of Student's t, z >= 0 (Abramowitz and Stegun 26.7.1)."""
    half, square = 0.5 * freedom, z * z
    ratio = _gamma_ratio(half)
    power = -half * math.log1p(square / freedom)
    near = square / (freedom + square)
    log_density = ratio - 0.5 * math.log(math.pi * freedom) + power - 0.5 * math.log1p(square / freedom)
    if z == 0.0:
        log_tail = -math.log(2.0)
    elif 1.0 - near < (half + 1.0) / (half + 2.5):
        beta = power + 0.5 * math.log(near) + ratio - math.log(ROOT_PI)
        log_tail = beta + math.log(_fraction(half, 0.5, freedom / (freedom + square)) / freedom)
    else:
        beta = math.exp(power + 0.5 * math.log(near) + ratio) / ROOT_PI
        log_tail = math.log(0.5 - beta * _fraction(0.5, half, near))
    return log_tail, math.exp(log_density - log_tail)


@kernel
def _tail(z: float, freedom: float):
    return _student_tail(z, freedom) if freedom > 0.0 else _normal_tail(z)


@kernel
def log_survival(z: float, freedom: float):
    """log of the probability of more than z."""
    if z >= 0.0:
        return _tail(z, freedom)[0]
    return math.log1p(-math.exp(_tail(-z, freedom)[0]))


@kernel
def from_log_survival(log_tail: float, freedom: float):
    """z with this `log_survival` <= 0, by Newton's method between bounds; -inf at 0."""
    if not log_tail < 0.0:
        return -math.inf
    upper = log_tail < -math.log(2.0)
    wanted = log_tail if upper else math.log(-math.expm1(log_tail))
    low, high = 0.0, 1.0
    while _tail(high, freedom)[0] > wanted and high < 1e300:
        low, high = high, 2.0 * high
    z = 0.5 * (low + high)
    for _ in range(STEPS):
        found, hazard = _tail(z, freedom)
        if found > wanted:
            low = z
        else:
            high = z
        step = z + (found - wanted) / hazard
        step = step if low < step < high else 0.5 * (low + high)
        change, z = abs(step - z), step
        if change <= ENOUGH * z or not low < high:
            break
    return z if upper else -z


@ieee_kernel
def fill_truncated(level: Array, mean: Array, deviation: Array, freedom: float, out: Array):
    """Fill `out` (n,) with quantiles, see `force_band.truncated_quantile`; all arrays (n,)."""
    for i in range(len(out)):
        out[i] = max(mean[i], 0.0)
        if deviation[i] > 0.0:
            log_tail = math.log1p(-level[i]) + log_survival(-mean[i] / deviation[i], freedom)
            out[i] = max(mean[i] + from_log_survival(log_tail, freedom) * deviation[i], 0.0)
