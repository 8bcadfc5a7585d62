"""Records in kernels: what a compiled node and its messages look like to compiled code.

A record is a numpy structure of fixed size that kernels read and write by name. An array of any length is in it as an
address and a shape, the memory being somebody else's: `floats`, `integers` and `longs` make an array of that.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.core.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from palpate.physics.kernel import Kernel, kernel

MOST = 20
"""Records that a kernel takes at most."""
RAISED = 1
"""Answer of `call` where the kernel raised."""

_BYTE = ir.IntType(8).as_pointer()
_INTEGER = ir.IntType(64)


def address(function: Kernel, *dtypes: np.dtype) -> int:
    """Address of the machine code of a kernel of these records and dt [s], for `call`; compiled or loaded if need
    be. TypeError: numba cannot compile it for them."""
    given = (*map(from_dtype, dtypes), types.float64)
    if given not in function.overloads:
        function.compile(given)
    code = function.overloads[given]
    return code.library.get_pointer_to_function(code.fndesc.llvm_func_name)


@intrinsic
def _invoke(typing: Any, function: Any, records: Any, count: Any, dt: Any) -> Any:
    """Call machine code at an address with `count` addresses of records and dt: (status, truth of its answer).

    The calling convention is numba's for a CPU: place of the answer, place of the exception, arguments.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, at, count, dt = arguments
        records = builder.inttoptr(at, _INTEGER.as_pointer())
        answer = cgutils.alloca_once_value(builder, ir.Constant(_INTEGER, 0))
        raised = cgutils.alloca_once(builder, _BYTE)
        status = cgutils.alloca_once_value(builder, ir.Constant(ir.IntType(32), RAISED))
        after = builder.append_basic_block("after")
        choice = builder.switch(count, after)
        for number in range(1, MOST + 1):
            block = builder.append_basic_block(f"records{number}")
            choice.add_case(ir.Constant(_INTEGER, number), block)
            with builder.goto_block(block):
                form = [_BYTE, _BYTE.as_pointer(), *[_BYTE] * number, ir.DoubleType()]
                called = builder.inttoptr(function, ir.FunctionType(ir.IntType(32), form).as_pointer())
                places = [builder.gep(records, [ir.Constant(_INTEGER, i)]) for i in range(number)]
                given = [builder.inttoptr(builder.load(place), _BYTE) for place in places]
                builder.store(builder.call(called, [builder.bitcast(answer, _BYTE), raised, *given, dt]), status)
                builder.branch(after)
        builder.position_at_end(after)
        truth = builder.trunc(builder.load(answer), ir.IntType(8))
        ended = builder.sext(builder.load(status), _INTEGER)
        return context.make_tuple(builder, signature.return_type, [ended, builder.zext(truth, _INTEGER)])

    form = types.UniTuple(types.int64, 2)(types.int64, types.int64, types.int64, types.float64)
    return form, generate


@kernel
def call(function, records, count, dt):
    """Call machine code (`address`) with `count` records, whose addresses lie one after the other at the address
    `records`: whether it raised, and the truth of what it answers."""
    status, truth = _invoke(function, records, count, dt)
    return status != 0, truth != 0


def _array_of(dtype: Any, ndim: int, record: Any) -> Any:
    """Form and generator of an array at an address that a record holds."""
    form = types.Array(dtype, ndim, "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        handle = arguments[0]
        words = builder.bitcast(handle, _INTEGER.as_pointer())
        word = [builder.load(builder.gep(words, [ir.Constant(_INTEGER, i)])) for i in range(1 + ndim)]
        array, size = make_array(form)(context, builder), context.get_abi_sizeof(context.get_data_type(dtype))
        steps = [ir.Constant(_INTEGER, size)]
        for length in reversed(word[2:]):
            steps.insert(0, builder.mul(steps[0], length))
        populate_array(
            array, data=builder.inttoptr(word[0], array.data.type), shape=word[1:], strides=steps,
            itemsize=ir.Constant(_INTEGER, size), meminfo=None,
        )  # fmt: skip
        return array._getvalue()

    return form(record), generate


@intrinsic
def floats(typing: Any, handle: Any) -> Any:
    """The array of numbers (n,) or (n,m) that a field of a record stands for."""
    return _array_of(types.float64, handle.typeof("shape").nitems, handle)


@intrinsic
def integers(typing: Any, handle: Any) -> Any:
    """The array of whole numbers (n,) or (n,m), 4 bytes each, that a field of a record stands for."""
    return _array_of(types.int32, handle.typeof("shape").nitems, handle)


@intrinsic
def longs(typing: Any, handle: Any) -> Any:
    """The array of whole numbers (n,) or (n,m), 8 bytes each, that a field of a record stands for."""
    return _array_of(types.int64, handle.typeof("shape").nitems, handle)


@intrinsic
def nth(typing: Any, several: Any, place: Any) -> Any:
    """One of the messages of an input that takes several."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = builder.bitcast(arguments[0], _INTEGER.as_pointer())
        at = builder.gep(words, [builder.add(arguments[1], ir.Constant(_INTEGER, 1))])
        return builder.inttoptr(builder.load(at), context.get_value_type(signature.return_type))

    return several.typeof("like")(several, types.int64), generate


@kernel
def vector(values):
    """Three numbers of a record as a tuple."""
    return values[0], values[1], values[2]


@kernel
def put(values, given):
    """Write three numbers into a record."""
    values[0], values[1], values[2] = given


@kernel
def one(values, number):
    """Make a number the only one of a vector of open length."""
    values.count = 1
    values.values[0] = number


def pointer(dtype: np.dtype) -> Any:
    """A function for kernels: the record of this form at an address."""
    form = from_dtype(dtype)

    @intrinsic
    def at(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return form(types.int64), generate

    return at


@intrinsic
def word(typing: Any, address: Any) -> Any:
    """The whole number at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], _INTEGER.as_pointer()))

    return types.int64(types.int64), generate


@intrinsic
def number(typing: Any, address: Any) -> Any:
    """The floating-point number at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], ir.DoubleType().as_pointer()))

    return types.float64(types.int64), generate


@intrinsic
def set_word(typing: Any, address: Any, value: Any) -> Any:
    """Write a whole number to an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[1], builder.inttoptr(arguments[0], _INTEGER.as_pointer()))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


@intrinsic
def copy(typing: Any, to: Any, source: Any, count: Any) -> Any:
    """Copy bytes from one address to another; the address after the copy."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        to, source, count = arguments
        cgutils.raw_memcpy(builder, builder.inttoptr(to, _BYTE), builder.inttoptr(source, _BYTE), count, 1)
        return builder.add(to, count)

    return types.int64(types.int64, types.int64, types.int64), generate


@intrinsic
def set_big(typing: Any, to: Any, value: Any) -> Any:
    """Write the eight bytes of a whole number to an address, the highest first; the address after it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        store = builder.store(builder.bswap(arguments[1]), builder.inttoptr(arguments[0], _INTEGER.as_pointer()))
        store.align = 1
        return builder.add(arguments[0], ir.Constant(_INTEGER, 8))

    return types.int64(types.int64, types.int64), generate
