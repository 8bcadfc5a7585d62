"""Memory in kernels: reads and writes by address, for tables and bytes, and small arrays on the stack."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending, from_dtype, types
from numba.core import cgutils
from numba.np.arrayobj import make_array, populate_array

from palpate.compiler import interpreted


def intrinsic(plain: Callable[..., Any], **options: Any) -> Any:
    """Decorator of a function that generates the code of an intrinsic; `plain` is the same in Python. Callers omit the
    first argument, the typing context."""
    if interpreted.ENABLED:
        return lambda _: plain
    return extending.intrinsic(**options) if options else extending.intrinsic


BYTE = ir.IntType(8).as_pointer()
INTEGER = ir.IntType(64)


def pointer(dtype: np.dtype) -> Any:
    """An intrinsic for kernels that returns the record of this dtype at an address."""
    form = from_dtype(dtype)

    @intrinsic(interpreted.record_at(dtype))
    def at(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return form(types.int64), generate

    return at


def _reader(form: Any, cell: ir.Type, plain: Callable[[int], Any]) -> Any:
    @intrinsic(plain)
    def read(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.load(builder.inttoptr(arguments[0], cell.as_pointer()))

        return form(types.int64), generate

    return read


word = _reader(types.int64, INTEGER, interpreted.word)  # the 64-bit integer at an address
number = _reader(types.float64, ir.DoubleType(), interpreted.number)  # the double at an address


@intrinsic(np.zeros, prefer_literal=True)
def stack_zeros(typing: Any, shape: Any) -> Any:
    """An array of zeros of a constant shape on the stack of the calling kernel, which must not return it. `np.zeros`
    would allocate memory at each call."""
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


@intrinsic(interpreted.set_word)
def set_word(typing: Any, address: Any, value: Any) -> Any:
    """Write a 64-bit integer to an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[1], builder.inttoptr(arguments[0], INTEGER.as_pointer()))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


@intrinsic(interpreted.copy)
def copy(typing: Any, to: Any, source: Any, count: Any) -> Any:
    """Copy `count` bytes from one address to another; returns the address after the copy."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        to, source, count = arguments
        cgutils.raw_memcpy(builder, builder.inttoptr(to, BYTE), builder.inttoptr(source, BYTE), count, 1)
        return builder.add(to, count)

    return types.int64(types.int64, types.int64, types.int64), generate


@intrinsic(interpreted.set_big)
def set_big(typing: Any, to: Any, value: Any) -> Any:
    """Write a 64-bit integer to an address in big-endian order; returns the address after it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        store = builder.store(builder.bswap(arguments[1]), builder.inttoptr(arguments[0], INTEGER.as_pointer()))
        store.align = 1
        return builder.add(arguments[0], ir.Constant(INTEGER, 8))

    return types.int64(types.int64, types.int64), generate


@intrinsic(interpreted.big)
def big(typing: Any, address: Any) -> Any:
    """The 64-bit integer in big-endian order at an address, which need not be aligned."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = builder.load(builder.inttoptr(arguments[0], INTEGER.as_pointer()))
        value.align = 1
        return builder.bswap(value)

    return types.int64(types.int64), generate
