"""Sine, cosine and their inverses in kernels, instead of those of the C library, whose last bits depend on the system.

Each has an error below 1 ulp; most are the nearest double. Angles are reduced to |r| <= pi/4, a sum of two doubles, by
pi/2 in four parts (W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980), above 2^20 by the
bits of 2/pi (M. H. Payne and R. N. Hanek, SIGNUM Newsletter 18 (1983) 19-24). sin(r) and cos(r) are polynomials in r²
that interpolate them at the Chebyshev nodes. The arctangent of y/x is the series about the nearest multiple of 1/32.
arcsin(s) is s + s³ times a polynomial of this kind in s² for s <= 1/2; sin(pi/4 - a/2)² = (1 - sin a)/2 leads to it
from a larger sine.
"""

import decimal
import math

import numpy as np

from palpate.compiler.doubles import BIAS, bits, fast_two_sum, fused, two_product, two_sum, two_to
from palpate.compiler.kernel import ieee_kernel
from palpate.compiler.memory import stack_zeros

DIGIT = 24  # Bits of a digit of 2/pi
BASE = 2.0**DIGIT
PARTS = 32  # of the ratios 0 to 1, for arctangents
COLUMNS = 8  # Digits of a product after its integer part: 192 bits, of which at most 62 cancel


def _arctangent(x: decimal.Decimal) -> decimal.Decimal:
    """arctan x by its series, |x| <= 1, halved twice by arctan x = 2 arctan(x/(1 + sqrt(1 + x²)))."""
    for _ in range(3):
        x = x / (1 + (1 + x * x).sqrt())
    least, ratio = decimal.Decimal(10) ** -decimal.getcontext().prec, -x * x
    total, power, k = decimal.Decimal(0), x, 1
    while abs(power) > least:
        total, power, k = total + power / k, power * ratio, k + 2
    return 8 * total


def _inverse_arctangent(n: int, unit: int) -> int:
    """arctan(1/n) in multiples of 1/unit, by its series."""
    power = total = unit // n
    for k in range(3, unit.bit_length(), 2):
        power //= -n * n
        total += power // k
    return total


def _pi(digits: int) -> decimal.Decimal:
    """pi = 16 arctan(1/5) - 4 arctan(1/239) (J. Machin, 1706), in whole numbers: ten times as fast as decimal ones."""
    unit = 10 ** (digits + 5)
    return decimal.Decimal(16 * _inverse_arctangent(5, unit) - 4 * _inverse_arctangent(239, unit)) / unit


def _series(c: float, count: int) -> list[float]:
    """Coefficients of arctan(c + h) in powers of h; its derivative is 1/(1 + c² + 2 c h + h²)."""
    slopes = [1.0 / (1.0 + c * c)]
    for n in range(1, count):
        slopes.append(-(2.0 * c * slopes[-1] + (slopes[n - 2] if n > 1 else 0.0)) * slopes[0])
    return [0.0] + [slope / (n + 1) for n, slope in enumerate(slopes)]


def _parts(x: decimal.Decimal, bits_of_each: tuple[int, ...]) -> tuple[float, ...]:
    """x as a sum of numbers with these numbers of bits after the point, and a double."""
    found = []
    for count in bits_of_each:
        found.append(math.floor(x * 2**count) / 2.0**count)
        x -= decimal.Decimal(found[-1])
    return (*found, float(x))


with decimal.localcontext() as _digits:
    _digits.prec = 420
    _PI = _pi(_digits.prec)
    TWO_BY_PI = float(2 / _PI)
    P1, P2, P3, P4 = _parts(_PI / 2, (32, 65, 98))
    HALF_PI, HALF_PI_REST = float(_PI / 2), float(_PI / 2 - decimal.Decimal(float(_PI / 2)))
    PI, PI_REST = 2.0 * HALF_PI, 2.0 * HALF_PI_REST
    _whole = int(2 / _PI * 2 ** (DIGIT * 56))
    DIGITS = np.array([_whole >> DIGIT * (55 - j) & (1 << DIGIT) - 1 for j in range(56)], float)  # of 2/pi
    _digits.prec = 50
    ARCTANGENTS = np.array([_parts(_arctangent(decimal.Decimal(i) / PARTS), (50,)) for i in range(PARTS + 1)])
SERIES = np.array([_series(i / PARTS, 9) for i in range(PARTS + 1)])


@ieee_kernel(inline=True)
def quadrant(x):
    """(n, r, s) of finite x = n pi/2 + r + s, |r| <= pi/4, n modulo 4."""
    if abs(x) > 2.0**20:
        return _quadrant_of_large(x)
    n = math.floor(fused(x, TWO_BY_PI, 0.5))
    if n == 0:
        return 0, x, 0.0
    r, s = two_sum(fused(-n, P1, x), -n * P2)
    r, more = two_sum(r, -n * P3)
    r, s = fast_two_sum(r, fused(-n, P4, s + more))
    return n & 3, r, s


@ieee_kernel
def _quadrant_of_large(x):
    """As `quadrant`: the digits of |x| times those of 2/pi, without the products that are multiples of 4."""
    q = ((bits(abs(x)) >> 52) - BIAS) // DIGIT
    rest = abs(x) * two_to(-DIGIT * q)
    limbs, digits = stack_zeros((4,)), stack_zeros((9,))
    for i in range(4):
        limbs[i] = math.floor(rest)
        rest = (rest - limbs[i]) * BASE
    carry = 0.0
    for p in range(COLUMNS, -1, -1):
        column = carry
        for i in range(4):
            j = p + q - 1 - i
            column += limbs[i] * DIGITS[j] if j >= 0 else 0.0
        carry = math.floor(column / BASE) * 1.0
        digits[p] = column - carry * BASE
    n = int(digits[0])
    if digits[1] >= 0.5 * BASE:
        n += 1
        digits[1] -= BASE
    high = low = 0.0
    for p in range(1, COLUMNS + 1):
        high, more = two_sum(high, digits[p] * two_to(-DIGIT * p))
        low += more
    r, s = two_product(high, HALF_PI)
    r, s = fast_two_sum(r, s + (high * HALF_PI_REST + low * HALF_PI))
    return (n & 3, r, s) if x > 0.0 else (-n & 3, -r, -s)


@ieee_kernel(inline=True)
def sine(r, s):
    """sin(r + s) of |r| <= pi/4 and |s| < ulp(r)."""
    z = r * r
    w = z * z
    even = fused(w, fused(w, -7.586636867766497e-13, -2.5052106225992787e-08), -0.0001984126984126504)
    even = fused(w, even, -0.16666666666666666)
    odd = fused(w, fused(w, 1.6058530596390244e-10, 2.7557319219320575e-06), 0.008333333333333331)
    return r + fused(z * r, fused(z, odd, even), s * fused(z, -0.5, 1.0))


@ieee_kernel(inline=True)
def cosine(r, s):
    """cos(r + s) of |r| <= pi/4 and |s| < ulp(r)."""
    z = r * r
    w = z * z
    even = fused(w, fused(w, 2.087614504910828e-09, 2.48015872987544e-05), 0.041666666666666664)
    odd = fused(w, fused(w, -1.1382544623404291e-11, -2.7557317265876615e-07), -0.0013888888888887389)
    high, low = fast_two_sum(1.0, -0.5 * z)
    return high + fused(w, fused(z, odd, even), fused(-r, s, low))


@ieee_kernel
def sin(x):
    """Sine of an angle [rad]."""
    if not abs(x) < math.inf:
        return math.nan
    if abs(x) < 2.0**-27:
        return x
    n, r, s = quadrant(x)
    size = cosine(r, s) if n & 1 else sine(r, s)
    return -size if n & 2 else size


@ieee_kernel
def cos(x):
    """Cosine of an angle [rad]."""
    if not abs(x) < math.inf:
        return math.nan
    n, r, s = quadrant(x)
    size = sine(r, s) if n & 1 else cosine(r, s)
    return -size if n & 2 != (n & 1) << 1 else size


@ieee_kernel(inline=True)
def _arctangent_parts(y, x):
    """arctan(y/x) as the sum of two doubles, for 0 <= y <= x, 1e-140 < x < 1e140."""
    inverse = 1.0 / x
    q = y * inverse
    i = np.uint64(fused(q, PARTS, 0.5))
    h = q - i * (1.0 / PARTS)
    z = h * h
    a = SERIES[i]
    even = fused(z, fused(z, fused(z, a[8], a[6]), a[4]), a[2])
    odd = fused(z, fused(z, fused(z, a[9], a[7]), a[5]), a[3])
    high, low = fast_two_sum(ARCTANGENTS[i, 0], h * a[1])
    low += fused(h, a[1], -(h * a[1])) + fused(fused(-q, x, y) * inverse, a[1], ARCTANGENTS[i, 1])
    return high, fused(z, fused(h, odd, even), low)


@ieee_kernel(inline=True)
def _angle(y, x):
    """The angle of (x, y), y >= 0, 1e-140 < max(|x|, y) < 1e140."""
    width = abs(x)
    if y > width:  # pi/2 and an angle of at most pi/4
        high, low = _arctangent_parts(width, y)
        if x > 0.0:
            high, low = -high, -low
        base, base_rest = HALF_PI, HALF_PI_REST
    else:
        high, low = _arctangent_parts(y, width)
        if x > 0.0:
            return high + low
        high, low = -high, -low
        base, base_rest = PI, PI_REST
    total, rest = fast_two_sum(base, high)
    return total + (rest + (base_rest + low))


@ieee_kernel
def atan2(y, x):
    """The angle [rad] of (x, y) from the x axis, -pi to pi."""
    if x != x or y != y:
        return math.nan
    back, height, width = bits(x) < 0, abs(y), abs(x)
    if height == math.inf or width == math.inf:
        if height == width:
            size = 0.75 * PI if back else 0.25 * PI
        else:
            size = HALF_PI if height == math.inf else PI if back else 0.0
    elif height == 0.0:
        size = PI if back else 0.0
    elif width < height * 2.0**-60:
        size = HALF_PI
    elif height < width * 2.0**-60:
        size = PI if back else height / width
    else:
        larger = max(height, width)
        factor = 2.0**-600 if larger > 1e140 else 2.0**800 if larger < 1e-140 else 1.0
        size = _angle(height * factor, x * factor)
    return -size if bits(y) < 0 else size


@ieee_kernel(inline=True)
def _excess(z):
    """(arcsin(s)/s - 1)/z of z = s² <= 1/4."""
    w = z * z
    even = fused(w, fused(w, -0.01924167174674304, 0.0030448799094556773), 0.009621842970100282)
    even = fused(w, fused(w, fused(w, even, 0.01396378001220357), 0.02237215744350722), 0.044642857142551895)
    odd = fused(w, fused(w, 0.02961201126495512, 0.019554513336123378), 0.009319560794767446)
    odd = fused(w, fused(w, fused(w, odd, 0.011566459612121669), 0.017352816540325496), 0.03038194447553234)
    odd = fused(w, odd, 0.07500000000000118)
    return fused(z, odd, fused(w, even, 0.16666666666666666))


@ieee_kernel(inline=True)
def _from_side(x):
    """The angle [rad] with the cosine 0.5 <= x < 1, as the sum of two doubles: 2 arcsin(sqrt((1 - x)/2))."""
    z = 0.5 * (1.0 - x)
    s = math.sqrt(z)
    rest = fused(-s, s, z) / (2.0 * s)
    return 2.0 * s, 2.0 * fused(s * z, _excess(z), rest)


@ieee_kernel
def acos(x):
    """The angle [rad] with this cosine, 0 to pi."""
    if not abs(x) < 1.0:
        return 0.0 if x == 1.0 else PI if x == -1.0 else math.nan
    if abs(x) < 0.5:
        z = x * x
        high, low = fast_two_sum(HALF_PI, -x)
        return high + (low + fused(-x * z, _excess(z), HALF_PI_REST))
    high, low = _from_side(abs(x))
    if x > 0.0:
        return high + low
    total, rest = fast_two_sum(PI, -high)
    return total + (rest + (PI_REST - low))


@ieee_kernel
def asin(x):
    """The angle [rad] with this sine, -pi/2 to pi/2."""
    if not abs(x) < 1.0:
        return HALF_PI * x if abs(x) == 1.0 else math.nan
    if abs(x) < 0.5:
        z = x * x
        return fused(x * z, _excess(z), x) if abs(x) > 2.0**-30 else x
    high, low = _from_side(abs(x))
    total, rest = fast_two_sum(HALF_PI, -high)
    size = total + (rest + (HALF_PI_REST - low))
    return size if x > 0.0 else -size


@ieee_kernel
def hypot(x, y):
    """sqrt(x² + y²), from the sum of the squares as two doubles."""
    if abs(x) == math.inf or abs(y) == math.inf:
        return math.inf
    if x != x or y != y:
        return math.nan
    longer, shorter = max(abs(x), abs(y)), min(abs(x), abs(y))
    if shorter <= longer * 2.0**-60:
        return longer
    factor = 2.0**-600 if longer > 1e140 else 2.0**800 if longer < 1e-140 else 1.0
    longer *= factor
    shorter *= factor
    square, rest = two_product(longer, longer)
    other, more = two_product(shorter, shorter)
    total, last = fast_two_sum(square, other)
    root = math.sqrt(total)
    square, error = two_product(root, root)
    return (root + ((total - square) - error + (last + rest + more)) / (2.0 * root)) / factor
