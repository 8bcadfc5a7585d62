"""Exponentials and logarithms in kernels, instead of those of the C library, whose last bits depend on the system.

Each has an error below 1 ulp; most are the nearest double. A logarithm is computed as the sum of two doubles: the
mantissa m is multiplied by one of 93 stored factors c near 1/m, and the series of ln(1 + f), f = c m - 1, |f| < 2^-7.4,
is added to the stored -ln c. e^x = 2^k e^r with |r| <= ln(2)/2; (e^r - 1 - r)/r² is the polynomial that interpolates it
at the Chebyshev nodes, with an error of 2^-61 of e^r.
"""

import decimal
import math

import numpy as np

from palpate.compiler.doubles import bits, fast_two_sum, fused, scaled, two_product, two_sum, two_to, with_bits
from palpate.compiler.kernel import ieee_kernel

GRID = 2.0**40  # Stored logarithms are multiples of 1/GRID plus a rest, so that k ln 2 - ln c is exact
FIRST, LAST = 90, 182  # 128 m of the stored factors
SPLIT = 0x3FE6A09E667F3BCD  # The bits of sqrt(1/2), the smallest mantissa

with decimal.localcontext() as _digits:
    _digits.prec = 40

    def _parts(x: decimal.Decimal) -> tuple[float, float]:
        high = round(float(x) * GRID) / GRID
        return high, float(x - decimal.Decimal(high))

    LN2, LN2_REST = _parts(decimal.Decimal(2).ln())
    BY_LN2 = float(1 / decimal.Decimal(2).ln())
    BY_LN2_REST = float(1 / decimal.Decimal(2).ln() - decimal.Decimal(BY_LN2))
    FACTORS = np.array([round(128.0 / i * 4096.0) / 4096.0 for i in range(FIRST, LAST + 1)])
    LOGS = np.array([_parts(-decimal.Decimal(c).ln()) for c in FACTORS.tolist()])

    def _root(x: decimal.Decimal) -> decimal.Decimal:
        """The cube root: a step of Newton doubles the digits of the nearest double. `**` takes 15 times as long."""
        y = decimal.Decimal(float(x) ** (1.0 / 3.0))
        for _ in range(2):
            y -= (y * y * y - x) / (3 * y * y)
        return y

    _of_two = [_root(decimal.Decimal(2**j)) for j in range(3)]
    _of_factors = [_root(1 / decimal.Decimal(c)) for c in FACTORS.tolist()]
    _roots = [[root * two for two in _of_two] for root in _of_factors]
    ROOTS = np.array([[(float(root), float(root - decimal.Decimal(float(root)))) for root in row] for row in _roots])
    ROOT_SERIES = tuple(math.prod(1.0 / 3.0 - n for n in range(j)) / math.factorial(j) for j in range(8))


@ieee_kernel(inline=True)
def split(x):
    """(k, m, i) of x = 2^k m > 0, sqrt(1/2) <= m < sqrt(2), and the number i of the factor near 1/m."""
    shift = 0
    if x < 2.0**-1000:
        x *= 2.0**100
        shift = 100
    word = bits(x)
    k = (word - SPLIT) >> 52
    m = with_bits(word - (k << 52))
    return k - shift, m, np.uint64(m * 128.0 + 0.5) - np.uint64(FIRST)


@ieee_kernel(inline=True)
def _series(f, square):
    """(ln(1 + f) - f + f²/2)/f³, from f and f²."""
    even = fused(square, fused(square, fused(square, 0.1, 1.0 / 8.0), 1.0 / 6.0), 1.0 / 4.0)
    odd = fused(square, fused(square, fused(square, 1.0 / 9.0, 1.0 / 7.0), 1.0 / 5.0), 1.0 / 3.0)
    return fused(-f, even, odd)


@ieee_kernel(inline=True)
def log_parts(x, rest):
    """ln(x + rest) as the sum of two doubles, for x > 0 and |rest| < ulp(x)."""
    k, m, i = split(x)
    c = FACTORS[i]
    product, more = two_product(c, m)
    f, f_rest = fast_two_sum(product - 1.0, more)
    if rest != 0.0:
        f_rest += rest * two_to(-k) * c
    square, square_rest = two_product(f, f)
    high, low = fast_two_sum(fused(k, LN2, LOGS[i, 0]), f)
    high, more = fast_two_sum(high, -0.5 * square)
    low += more + f_rest * (1.0 - f) - 0.5 * square_rest + fused(k, LN2_REST, LOGS[i, 1])
    return fast_two_sum(high, fused(square * f, _series(f, square), low))


@ieee_kernel
def log(x):
    """ln x."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else x if x == math.inf else math.nan
    k, m, i = split(x)
    product, rest = two_product(FACTORS[i], m)
    f = product - 1.0
    square = f * f
    high, low = fast_two_sum(fused(k, LN2, LOGS[i, 0]), f)
    low += rest + fused(k, LN2_REST, LOGS[i, 1])
    return high + fused(square, fused(f, _series(f, square), -0.5), low)


@ieee_kernel
def log2(x):
    """Logarithm to base 2, exact for powers of 2."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else x if x == math.inf else math.nan
    k, m, _ = split(x)
    high, low = log_parts(m, 0.0)
    product, rest = two_product(high, BY_LN2)
    rest += fused(high, BY_LN2_REST, low * BY_LN2)
    total, more = two_sum(k * 1.0, product)
    return total + (more + rest)


@ieee_kernel
def log1p(x):
    """ln(1 + x)."""
    if not -1.0 < x < math.inf:
        return -math.inf if x == -1.0 else x if x == math.inf else math.nan
    if abs(x) < 2.0**-54:
        return x
    total, rest = two_sum(1.0, x)
    return log_parts(total, rest)[0]


@ieee_kernel(inline=True)
def reduced(x, rest):
    """(k, r, s) of x + rest = k ln 2 + r + s, |r| < 0.35, |x| < 750."""
    k = math.floor(fused(x, 1.0 / LN2, 0.5))
    r, s = fast_two_sum(fused(-k, LN2, x), fused(-k, LN2_REST, rest))
    return k, r, s


@ieee_kernel(inline=True)
def curvature(r):
    """e^r - 1 - r for |r| < 0.35."""
    z = r * r
    even = fused(z, fused(z, 2.0914717341716378e-09, 2.755727357010214e-07), 2.4801587325605324e-05)
    even = fused(z, fused(z, fused(z, even, 0.001388888888888373), 0.04166666666666667), 0.5)
    odd = fused(z, fused(z, 2.5105259538448494e-08, 2.7557255297969643e-06), 0.0001984126987490126)
    odd = fused(z, fused(z, odd, 0.008333333333326112), 0.1666666666666667)
    return z * fused(r, odd, even)


@ieee_kernel(inline=True)
def exp_of(x, rest):
    """e^(x + rest)."""
    if x > 709.79:
        return math.inf
    if x < -745.14:
        return 0.0
    k, r, s = reduced(x, rest)
    return scaled(1.0 + (r + (s * (1.0 + r) + curvature(r))), k)


@ieee_kernel
def exp(x):
    """e^x."""
    if x != x:
        return x
    return exp_of(x, 0.0)


@ieee_kernel
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


@ieee_kernel
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


@ieee_kernel(inline=True)
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


@ieee_kernel(inline=True)
def cbrt(x):
    """The cube root of x."""
    if x == 0.0 or x != x or abs(x) == math.inf:
        return x
    k, m, i = split(abs(x))
    third = (k + 3000) // 3 - 1000
    product, rest = two_product(FACTORS[i], m)
    f = (product - 1.0) + rest
    z = f * f
    even = fused(z, fused(z, ROOT_SERIES[6], ROOT_SERIES[4]), ROOT_SERIES[2])
    odd = fused(z, fused(z, ROOT_SERIES[7], ROOT_SERIES[5]), ROOT_SERIES[3])
    change = fused(z, fused(f, odd, even), f * (1.0 / 3.0))
    j = k - 3 * third
    root = ROOTS[i, j, 0]
    size = (root + fused(root, change, ROOTS[i, j, 1])) * two_to(third)
    return size if x > 0.0 else -size
