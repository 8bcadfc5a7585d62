"""Parts of double-precision numbers in kernels: their bits, and sums and products with their rounding errors.

`fused` is an operation of IEEE 754, with the same bits on each processor. Results differ where a compiler may replace a
product and a sum by it, which kernels do not permit.
"""

from typing import Any

from llvmlite import ir
from numba import types

from palpate.compiler import interpreted
from palpate.compiler.kernel import kernel
from palpate.compiler.memory import intrinsic

MANTISSA, BIAS = 52, 1023  # Bits after the point, and what is added to the exponent


@intrinsic(interpreted.bits)
def bits(typing: Any, x: Any) -> Any:
    """The 64 bits of a double as an integer."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


@intrinsic(interpreted.with_bits)
def with_bits(typing: Any, word: Any) -> Any:
    """The double with these bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), generate


@intrinsic(interpreted.fused)
def fused(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


@kernel(error_model="numpy", inline=True)
def two_to(k):
    """2^k of an integer, -1022 <= k <= 1023."""
    return with_bits((k + BIAS) << MANTISSA)


@kernel(error_model="numpy", inline=True)
def scaled(x, k):
    """x 2^k, rounded once, for -1070 < k < 1100 and 0.5 < |x| < 4."""
    if k > 1000:
        return x * two_to(k - 100) * 2.0**100
    if k < -1000:
        return x * two_to(k + 100) * 2.0**-100
    return x * two_to(k)


@kernel(error_model="numpy", inline=True)
def two_sum(a, b):
    """a + b and its rounding error (D. E. Knuth, The Art of Computer Programming 2, 4.2.2)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@kernel(error_model="numpy", inline=True)
def fast_two_sum(a, b):
    """a + b and its rounding error for |a| >= |b| or a = 0 (T. J. Dekker, Numer. Math. 18 (1971) 224-242)."""
    total = a + b
    return total, (a - total) + b


@kernel(error_model="numpy", inline=True)
def two_product(a, b):
    """a b and its rounding error, unless it underflows or overflows."""
    product = a * b
    return product, fused(a, b, -product)
