"""Exponentials and logarithms in kernels, instead of those of the C library, whose last bits depend on the system.

Each has an error below 1 ulp; most are the nearest double. A logarithm is computed as the sum of two doubles: the
mantissa m is multiplied by one of 93 stored factors c near 1/m, and the series of ln(1 + f), f = c m - 1, |f| < 2^-7.4,
is added to the stored -ln c. e^x = 2^k e^r with |r| <= ln(2)/2; (e^r - 1 - r)/r² is the polynomial that interpolates it
at the Chebyshev nodes, with an error of 2^-61 of e^r.
"""

import decimal
import math

import numpy as np

from palpate.compiler.doubles import bits, fast_two_sum, halves, scaled, two_product, two_sum, two_to, with_bits
from palpate.compiler.kernel import kernel, replaces

GRID = 2.0**40  # Stored logarithms are multiples of 1/GRID plus a rest, so that k ln 2 - ln c is exact
FIRST, LAST = 90, 182  # 128 m of the stored factors
SPLIT = 0x3FE6A09E667F3BCD  # The bits of sqrt(1/2), the smallest mantissa

with decimal.localcontext() as _digits:
    _digits.prec = 50

    def _parts(x: decimal.Decimal) -> tuple[float, float]:
        high = round(float(x) * GRID) / GRID
        return high, float(x - decimal.Decimal(high))

    LN2, LN2_REST = _parts(decimal.Decimal(2).ln())
    BY_LN2 = float(1 / decimal.Decimal(2).ln())
    BY_LN2_REST = float(1 / decimal.Decimal(2).ln() - decimal.Decimal(BY_LN2))
    FACTORS = np.array([round(128.0 / i * 4096.0) / 4096.0 for i in range(FIRST, LAST + 1)])
    LOGS = np.array([_parts(-decimal.Decimal(c).ln()) for c in FACTORS.tolist()])


@kernel(error_model="numpy")
def log_parts(x, rest):
    """ln(x + rest) as the sum of two doubles, for x > 0 and |rest| < ulp(x)."""
    shift = 100 if x < 2.0**-1000 else 0
    word = bits(x * 2.0**100 if shift > 0 else x)
    k = (word - SPLIT) >> 52
    m = with_bits(word - (k << 52))
    k -= shift
    i = int(m * 128.0 + 0.5) - FIRST
    c = FACTORS[i]
    m1, m2 = halves(m)
    f, f_rest = fast_two_sum(m1 * c - 1.0, m2 * c)
    if rest != 0.0:
        f_rest += rest * two_to(-k) * c
    square, square_rest = two_product(f, f)
    even = 1.0 / 4.0 + square * (1.0 / 6.0 + square * (1.0 / 8.0 + square * (1.0 / 10.0)))
    odd = 1.0 / 3.0 + square * (1.0 / 5.0 + square * (1.0 / 7.0 + square * (1.0 / 9.0)))
    high, low = fast_two_sum(k * LN2 + LOGS[i, 0], f)
    high, more = fast_two_sum(high, -0.5 * square)
    low += more + f_rest * (1.0 - f) - 0.5 * square_rest + (k * LN2_REST + LOGS[i, 1]) + square * f * (odd - f * even)
    return fast_two_sum(high, low)


@replaces("llvm.log.f64", "log")
@kernel(error_model="numpy")
def log(x):
    """ln x."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else x if x == math.inf else math.nan
    return log_parts(x, 0.0)[0]


@replaces("llvm.log2.f64", "log2")
@kernel(error_model="numpy")
def log2(x):
    """Logarithm to base 2, exact for powers of 2."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else x if x == math.inf else math.nan
    shift = 100 if x < 2.0**-1000 else 0
    word = bits(x * 2.0**100 if shift > 0 else x)
    k = (word - SPLIT) >> 52
    high, low = log_parts(with_bits(word - (k << 52)), 0.0)
    product, rest = two_product(high, BY_LN2)
    rest += high * BY_LN2_REST + low * BY_LN2
    total, more = two_sum((k - shift) * 1.0, product)
    return total + (more + rest)


@replaces("log1p")
@kernel(error_model="numpy")
def log1p(x):
    """ln(1 + x)."""
    if not -1.0 < x < math.inf:
        return -math.inf if x == -1.0 else x if x == math.inf else math.nan
    if abs(x) < 2.0**-54:
        return x
    total, rest = two_sum(1.0, x)
    return log_parts(total, rest)[0]


@kernel(error_model="numpy")
def reduced(x, rest):
    """(k, r, s) of x + rest = k ln 2 + r + s, |r| < 0.35, |x| < 750."""
    k = math.floor(x * (1.0 / LN2) + 0.5)
    low = rest - k * LN2_REST
    r, s = fast_two_sum(x - k * LN2, low)
    return k, r, s


@kernel(error_model="numpy")
def curvature(r):
    """e^r - 1 - r for |r| < 0.35."""
    z = r * r
    even = 0.001388888888888373 + z * (
        2.4801587325605324e-05 + z * (2.755727357010214e-07 + z * 2.0914717341716378e-09)
    )
    even = 0.5 + z * (0.04166666666666667 + z * even)
    odd = 0.0001984126987490126 + z * (2.7557255297969643e-06 + z * 2.5105259538448494e-08)
    odd = 0.1666666666666667 + z * (0.008333333333326112 + z * odd)
    return z * (even + r * odd)


@kernel(error_model="numpy")
def exp_of(x, rest):
    """e^(x + rest)."""
    if x > 709.79:
        return math.inf
    if x < -745.14:
        return 0.0
    k, r, s = reduced(x, rest)
    return scaled(1.0 + (r + (s * (1.0 + r) + curvature(r))), k)


@replaces("llvm.exp.f64", "exp")
@kernel(error_model="numpy")
def exp(x):
    """e^x."""
    if x != x:
        return x
    return exp_of(x, 0.0)


@replaces("expm1")
@kernel(error_model="numpy")
def expm1(x):
    """e^x - 1."""
    if x != x or abs(x) < 2.0**-54:
        return x
    if x > 709.79:
        return math.inf
    if x < -38.0:
        return -1.0
    k, r, s = reduced(x, 0.0)
    change = s * (1.0 + r) + curvature(r)
    if k == 0:
        return r + change
    if k > 60:
        return scaled(1.0 + (r + change), k) - 1.0
    power = two_to(k)
    high, low = two_sum(power, -1.0)
    high, more = two_sum(high, power * r)
    return high + (low + more + power * change)


@replaces("llvm.pow.f64", "pow")
@kernel(error_model="numpy")
def power(x, y):
    """x^y."""
    if y == 0.0 or x == 1.0:
        return 1.0
    if x != x or y != y:
        return math.nan
    large = abs(y) >= 2.0**53
    whole = large or math.floor(y) == y
    odd = whole and not large and math.floor(y) & 1 == 1
    if abs(y) == math.inf:
        if abs(x) == 1.0:
            return 1.0
        return math.inf if (abs(x) > 1.0) == (y > 0.0) else 0.0
    negative = odd and bits(x) < 0
    if x == 0.0 or abs(x) == math.inf:
        size = math.inf if (x == 0.0) == (y < 0.0) else 0.0
    elif x < 0.0 and not whole:
        return math.nan
    else:
        size = _power(abs(x), y)
    return -size if negative else size


@kernel(error_model="numpy")
def _power(x, y):
    high, low = log_parts(x, 0.0)
    if high == 0.0:
        return 1.0
    if abs(high * y) > 750.0 or abs(y) > 1e290:
        return math.inf if (high > 0.0) == (y > 0.0) else 0.0
    if abs(high * y) < 1e-290:
        return 1.0
    exponent, rest = two_product(high, y)
    return exp_of(exponent, rest + low * y)


@kernel(error_model="numpy")
def cbrt(x):
    """The cube root of x: e^(ln|x|/3), and a Newton step with the residual of twice the precision."""
    if x == 0.0 or x != x or abs(x) == math.inf:
        return x
    size, factor = abs(x), 1.0
    if size < 2.0**-900:
        size, factor = size * 2.0**300, 2.0**-100
    elif size > 2.0**900:
        size, factor = size * 2.0**-300, 2.0**100
    t = exp_of(log_parts(size, 0.0)[0] / 3.0, 0.0)
    square, rest = two_product(t, t)
    cube, more = two_product(square, t)
    t = (t - ((cube - size) + (more + rest * t)) / (3.0 * square)) * factor
    return t if x > 0.0 else -t
