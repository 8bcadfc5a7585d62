"""Generated code of `compiler.records`."""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils

from palpate.compiler.generators.in_record import array as array_at
from palpate.compiler.generators.in_record import element_of, read, type_of
from palpate.compiler.generators.memory import BYTE, INTEGER
from palpate.compiler.records import MOST, RAISED


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


def array_of(element: str | np.dtype) -> Callable[..., Any]:
    """The generator for arrays of this element type."""

    def array(typing: Any, handle: Any) -> Any:
        form = types.Array(element_of(element), handle.typeof("shape").nitems, "C")

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            words = builder.bitcast(arguments[0], INTEGER.as_pointer())
            places = [builder.gep(words, [ir.Constant(INTEGER, i)]) for i in range(1 + form.ndim)]
            return array_at(context, builder, form, [builder.load(place) for place in places])

        return form(handle), generate

    return array


def unpacking(kind: type) -> Callable[..., Any]:
    """The generator for this NamedTuple."""

    def unpack(typing: Any, record: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return read(context, builder, kind, builder.bitcast(arguments[0], BYTE))

        return type_of(kind)(record), generate

    return unpack


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
