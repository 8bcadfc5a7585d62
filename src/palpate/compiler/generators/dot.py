"""Generated code of `compiler.dot`."""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils


def inner(lanes: int) -> Callable[..., Any]:
    """The generator for this number of parallel partial sums."""

    def product(typing: Any, a: Any, b: Any) -> Any:
        if not (isinstance(a, types.Array) and a.ndim == 1 and a.layout == "C" and a.dtype == b.dtype):
            return None

        def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            number, index = context.get_value_type(a.dtype), context.get_value_type(types.intp)
            vector = ir.VectorType(number, lanes)
            first, second = (
                context.make_array(kind)(context, builder, value)
                for kind, value in zip(signature.args, args, strict=True)
            )
            size = cgutils.unpack_tuple(builder, first.shape)[0]
            zero = ir.Constant(number, 0.0)
            partial = cgutils.alloca_once_value(builder, ir.Constant(vector, [0.0] * lanes))
            total = cgutils.alloca_once_value(builder, zero)
            whole = builder.udiv(size, index(lanes))
            with cgutils.for_range(builder, whole) as loop:
                at = builder.mul(loop.index, index(lanes))
                x, y = (
                    builder.load(
                        builder.bitcast(builder.gep(one.data, [at]), vector.as_pointer()), align=a.dtype.bitwidth // 8
                    )
                    for one in (first, second)
                )
                builder.store(builder.fadd(builder.load(partial), builder.fmul(x, y)), partial)
            width, sums = lanes, builder.load(partial)
            while width > 1:
                width //= 2
                low, high = (
                    ir.Constant(ir.VectorType(ir.IntType(32), width), list(range(start, start + width)))
                    for start in (0, width)
                )
                sums = builder.fadd(builder.shuffle_vector(sums, sums, low), builder.shuffle_vector(sums, sums, high))
            builder.store(builder.extract_element(sums, ir.IntType(32)(0)), total)
            with cgutils.for_range_slice(builder, builder.mul(whole, index(lanes)), size, index(1)) as (at, _):
                x, y = (builder.load(builder.gep(one.data, [at])) for one in (first, second))
                builder.store(builder.fadd(builder.load(total), builder.fmul(x, y)), total)
            return builder.load(total)

        return a.dtype(a, b), build

    return product
