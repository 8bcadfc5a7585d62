"""Products of vectors and matrices within kernels, in an order of their sums that the code says, not the compiler.

numba hands `np.dot` and `@` to BLAS, which chooses the order by the processor. A plain loop has one order, but one
number at a time. Here `LANES` sums run beside each other, which are vectors of the processor, and are added up at the
end; on any processor the result is the same.
"""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.cgutils import ir
from numba.extending import intrinsic

from palpate.physics.kernel import kernel

LANES = 16  # Sums beside each other: four vectors of double precision, so that none waits for the one before


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


inner: Any = intrinsic(_inner)  # a.b of contiguous vectors (n,) of one precision, within a kernel


@kernel
def times(matrix, x, out):
    """matrix (n,m) times x (m,) into out (n,); all of one precision."""
    for i in range(len(out)):
        out[i] = inner(matrix[i], x)


@kernel
def add_products(a, b, out):
    """Add a'b to out (n,m), of a (k,n) and b (k,m)."""
    for k in range(len(a)):
        for i in range(len(out)):
            for j in range(len(out[i])):
                out[i, j] += a[k, i] * b[k, j]


@kernel
def left_times(x, matrix, out):
    """x (n,) times matrix (n,m) into out (m,)."""
    out[:] = 0.0
    for i in range(len(x)):
        for j in range(len(out)):
            out[j] += x[i] * matrix[i, j]
