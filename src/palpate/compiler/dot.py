"""Products of vectors and matrices in kernels, with a fixed order of summation.

For `np.dot` and `@` numba calls BLAS, whose order of summation depends on the processor. A plain loop has a fixed order
but is not vectorised. Here `LANES` partial sums in vector registers are added at the end, with the same result on every
processor.
"""

from functools import partial
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from palpate.compiler import interpreted
from palpate.compiler.kernel import kernel
from palpate.compiler.memory import intrinsic

LANES = 16  # Parallel partial sums: four vector registers of doubles, to hide the latency of the addition


def _inner(typingctx, a, b):  # type: ignore[no-untyped-def]
    if not (isinstance(a, types.Array) and a.ndim == 1 and a.layout == "C" and a.dtype == b.dtype):
        return None

    def build(context, builder, signature, args):  # type: ignore[no-untyped-def]
        number, index = context.get_value_type(a.dtype), context.get_value_type(types.intp)
        vector = ir.VectorType(number, LANES)
        first, second = (
            context.make_array(kind)(context, builder, value) for kind, value in zip(signature.args, args, strict=True)
        )
        size = cgutils.unpack_tuple(builder, first.shape)[0]
        zero = ir.Constant(number, 0.0)
        lanes = cgutils.alloca_once_value(builder, ir.Constant(vector, [0.0] * LANES))
        total = cgutils.alloca_once_value(builder, zero)
        whole = builder.udiv(size, index(LANES))
        with cgutils.for_range(builder, whole) as loop:
            at = builder.mul(loop.index, index(LANES))
            x, y = (
                builder.load(
                    builder.bitcast(builder.gep(one.data, [at]), vector.as_pointer()), align=a.dtype.bitwidth // 8
                )
                for one in (first, second)
            )
            builder.store(builder.fadd(builder.load(lanes), builder.fmul(x, y)), lanes)
        width, sums = LANES, builder.load(lanes)
        while width > 1:
            width //= 2
            low, high = (
                ir.Constant(ir.VectorType(ir.IntType(32), width), list(range(start, start + width)))
                for start in (0, width)
            )
            sums = builder.fadd(builder.shuffle_vector(sums, sums, low), builder.shuffle_vector(sums, sums, high))
        builder.store(builder.extract_element(sums, ir.IntType(32)(0)), total)
        with cgutils.for_range_slice(builder, builder.mul(whole, index(LANES)), size, index(1)) as (at, _):
            x, y = (builder.load(builder.gep(one.data, [at])) for one in (first, second))
            builder.store(builder.fadd(builder.load(total), builder.fmul(x, y)), total)
        return builder.load(total)

    return a.dtype(a, b), build


inner: Any = intrinsic(partial(interpreted.inner, lanes=LANES))(
    _inner
)  # a.b of contiguous vectors (n,) of one precision, in a kernel


@kernel
def cross(p, q):
    """p x q of two triples."""
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@kernel
def dot(p, q):
    """p . q of two triples."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@kernel
def times(matrix, x, out):
    """out = A x, of A = matrix (n,m) and x (m,) into out (n,); all of one precision."""
    for i in range(len(out)):
        out[i] = inner(matrix[i], x)


@kernel
def add_products(a, b, out):
    """out += a'b, of a (k,n) and b (k,m) into out (n,m)."""
    for k in range(len(a)):
        for i in range(len(out)):
            for j in range(len(out[i])):
                out[i, j] += a[k, i] * b[k, j]


@kernel
def left_times(x, matrix, out):
    """out = x A, of x (n,) and A = matrix (n,m) into out (m,)."""
    out[:] = 0.0
    for i in range(len(x)):
        for j in range(len(out)):
            out[j] += x[i] * matrix[i, j]
