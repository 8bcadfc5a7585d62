"""Parts of double-precision numbers in kernels: their bits, and sums and products with their rounding errors.

`fused` is an operation of IEEE 754, with the same bits on each processor. Results differ where a compiler may replace a
product and a sum by it, which kernels do not permit.
"""

from palpate.compiler import interpreted
from palpate.compiler.kernel import ieee_kernel
from palpate.compiler.target.intrinsic import intrinsic

MANTISSA, BIAS = 52, 1023  # Bits after the point, and what is added to the exponent


bits = intrinsic(interpreted.bits, "doubles.bits")
"""The 64 bits of a double as an integer."""

with_bits = intrinsic(interpreted.with_bits, "doubles.with_bits")
"""The double with these bits."""

fused = intrinsic(interpreted.fused, "doubles.fused")
"""a b + c, rounded once: `fused(a, b, c)`."""


@ieee_kernel(inline=True)
def two_to(k):
    """2^k of an integer, -1022 <= k <= 1023."""
    return with_bits((k + BIAS) << MANTISSA)


@ieee_kernel(inline=True)
def scaled(x, k):
    """x 2^k, rounded once, for -1070 < k < 1100 and 0.5 < |x| < 4."""
    if k > 1000:
        return x * two_to(k - 100) * 2.0**100
    if k < -1000:
        return x * two_to(k + 100) * 2.0**-100
    return x * two_to(k)


@ieee_kernel(inline=True)
def two_sum(a, b):
    """a + b and its rounding error (D. E. Knuth, The Art of Computer Programming 2, 4.2.2)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@ieee_kernel(inline=True)
def fast_two_sum(a, b):
    """a + b and its rounding error for |a| >= |b| or a = 0 (T. J. Dekker, Numer. Math. 18 (1971) 224-242)."""
    total = a + b
    return total, (a - total) + b


@ieee_kernel(inline=True)
def two_product(a, b):
    """a b and its rounding error, unless it underflows or overflows."""
    product = a * b
    return product, fused(a, b, -product)
