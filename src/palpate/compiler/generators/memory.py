"""Generated code of `compiler.memory`."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.np.arrayobj import make_array, populate_array

BYTE = ir.IntType(8).as_pointer()
INTEGER = ir.IntType(64)


def pointer(dtype: np.dtype) -> Callable[..., Any]:
    """The generator for the record of this dtype at an address."""
    form = from_dtype(dtype)

    def at(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return form(types.int64), generate

    return at


def word(typing: Any, address: Any) -> Any:
    return _read(types.int64, INTEGER)


def number(typing: Any, address: Any) -> Any:
    return _read(types.float64, ir.DoubleType())


def _read(form: Any, cell: ir.Type) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], cell.as_pointer()))

    return form(types.int64), generate


def stack_zeros(typing: Any, shape: Any) -> Any:
    sizes = [size.literal_value for size in shape]
    kind = types.Array(types.float64, len(sizes), "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        form = ir.ArrayType(ir.DoubleType(), math.prod(sizes))
        memory = cgutils.alloca_once(builder, form, zfill=True)
        array = make_array(kind)(context, builder)
        lengths = [ir.Constant(INTEGER, size) for size in sizes]
        strides = [ir.Constant(INTEGER, 8 * math.prod(sizes[k + 1 :])) for k in range(len(sizes))]
        data = builder.bitcast(memory, array.data.type)
        populate_array(array, data, lengths, strides, ir.Constant(INTEGER, 8), meminfo=None)
        return array._getvalue()

    return kind(shape), generate


def set_word(typing: Any, address: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[1], builder.inttoptr(arguments[0], INTEGER.as_pointer()))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


def copy(typing: Any, to: Any, source: Any, count: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        to, source, count = arguments
        cgutils.raw_memcpy(builder, builder.inttoptr(to, BYTE), builder.inttoptr(source, BYTE), count, 1)
        return builder.add(to, count)

    return types.int64(types.int64, types.int64, types.int64), generate


def set_big(typing: Any, to: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        store = builder.store(builder.bswap(arguments[1]), builder.inttoptr(arguments[0], INTEGER.as_pointer()))
        store.align = 1
        return builder.add(arguments[0], ir.Constant(INTEGER, 8))

    return types.int64(types.int64, types.int64), generate


def big(typing: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = builder.load(builder.inttoptr(arguments[0], INTEGER.as_pointer()))
        value.align = 1
        return builder.bswap(value)

    return types.int64(types.int64), generate
