"""Generated code of `compiler.records`."""

from collections.abc import Callable
from typing import Any, get_args, get_origin

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.np.arrayobj import make_array, populate_array

from palpate.compiler.generators.memory import BYTE, INTEGER
from palpate.compiler.records import MOST, RAISED, form, members_of

NUMBERS = {float: types.float64, int: types.int64, bool: types.boolean}


def invoke(typing: Any, function: Any, records: Any, count: Any, dt: Any) -> Any:
    """numba's calling convention for CPUs: address of the result, address of the exception, arguments."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, at, count, dt = arguments
        records = builder.inttoptr(at, INTEGER.as_pointer())
        result = cgutils.alloca_once_value(builder, ir.Constant(INTEGER, 0))
        raised = cgutils.alloca_once(builder, BYTE)
        status = cgutils.alloca_once_value(builder, ir.Constant(ir.IntType(32), RAISED))
        after = builder.append_basic_block("after")
        choice = builder.switch(count, after)
        for number in range(1, MOST + 1):
            block = builder.append_basic_block(f"records{number}")
            choice.add_case(ir.Constant(INTEGER, number), block)
            with builder.goto_block(block):
                form = [BYTE, BYTE.as_pointer(), *[BYTE] * number, ir.DoubleType()]
                called = builder.inttoptr(function, ir.FunctionType(ir.IntType(32), form).as_pointer())
                places = [builder.gep(records, [ir.Constant(INTEGER, i)]) for i in range(number)]
                given = [builder.inttoptr(builder.load(place), BYTE) for place in places]
                builder.store(builder.call(called, [builder.bitcast(result, BYTE), raised, *given, dt]), status)
                builder.branch(after)
        builder.position_at_end(after)
        boolean = builder.trunc(builder.load(result), ir.IntType(8))
        ended = builder.sext(builder.load(status), INTEGER)
        return context.make_tuple(builder, signature.return_type, [ended, builder.zext(boolean, INTEGER)])

    form = types.UniTuple(types.int64, 2)(types.int64, types.int64, types.int64, types.float64)
    return form, generate


ELEMENTS: dict[str, Any] = {
    "<f8": types.float64, "<f4": types.float32, "<i8": types.int64, "<i4": types.int32, "|u1": types.uint8,
    "|b1": types.boolean,
}  # fmt: skip
"""Element types of arrays."""


def _element(element: str | np.dtype) -> Any:
    return ELEMENTS[element] if isinstance(element, str) else from_dtype(element)


def _array(context: Any, builder: Any, form: Any, handle: Any) -> Any:
    """The array whose address and shape are in memory at `handle`."""
    words = builder.bitcast(handle, INTEGER.as_pointer())
    word = [builder.load(builder.gep(words, [ir.Constant(INTEGER, i)])) for i in range(1 + form.ndim)]
    array, size = make_array(form)(context, builder), context.get_abi_sizeof(context.get_data_type(form.dtype))
    steps = [ir.Constant(INTEGER, size)]
    for length in reversed(word[2:]):
        steps.insert(0, builder.mul(steps[0], length))
    populate_array(
        array, data=builder.inttoptr(word[0], array.data.type), shape=word[1:], strides=steps,
        itemsize=ir.Constant(INTEGER, size), meminfo=None,
    )  # fmt: skip
    return array._getvalue()


def array_of(element: str | np.dtype) -> Callable[..., Any]:
    """The generator for arrays of this element type."""

    def array(typing: Any, handle: Any) -> Any:
        form = types.Array(_element(element), handle.typeof("shape").nitems, "C")
        return form(handle), lambda context, builder, _, given: _array(context, builder, form, given[0])

    return array


def unpacking(kind: type) -> Callable[..., Any]:
    """The generator for this NamedTuple."""

    def unpack(typing: Any, record: Any) -> Any:
        return _type(kind)(record), lambda context, builder, _, given: _unpack_member(context, builder, kind, given[0])

    return unpack


def _type(hint: Any) -> Any:
    if hasattr(hint, "__metadata__"):
        element, ndim = hint.__metadata__
        return types.Array(_element(element), ndim, "C")
    if get_origin(hint) is tuple:
        return types.UniTuple(types.float64, len(get_args(hint)))
    if hint in NUMBERS:
        return NUMBERS[hint]
    return types.BaseTuple.from_types([_type(member) for _, member in members_of(hint)], hint)


def _unpack_member(context: Any, builder: Any, hint: Any, at: Any) -> Any:
    """The value of a member of a record at an address."""
    if hasattr(hint, "__metadata__"):
        return _array(context, builder, _type(hint), at)
    if hint in NUMBERS:
        kind = NUMBERS[hint]
        return context.unpack_value(builder, kind, builder.bitcast(at, context.get_data_type(kind).as_pointer()))
    at = builder.bitcast(at, BYTE)
    if get_origin(hint) is tuple:
        members = [(8 * place, float) for place in range(len(get_args(hint)))]
    else:
        record = form(hint)
        members = [(record.fields[name][1], member) for name, member in members_of(hint)]  # type: ignore[index]
    values = [
        _unpack_member(context, builder, member, builder.gep(at, [ir.Constant(INTEGER, offset)]))
        for offset, member in members
    ]
    return context.make_tuple(builder, _type(hint), values)


def nth(typing: Any, several: Any, place: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = builder.bitcast(arguments[0], INTEGER.as_pointer())
        at = builder.gep(words, [builder.add(arguments[1], ir.Constant(INTEGER, 1))])
        return builder.inttoptr(builder.load(at), context.get_value_type(signature.return_type))

    return several.typeof("like")(several, types.int64), generate


def clear(typing: Any, record: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        size = ir.Constant(INTEGER, signature.args[0].size)
        cgutils.memset(builder, builder.bitcast(arguments[0], BYTE), size, 0)
        return context.get_dummy_value()

    return types.void(record), generate
