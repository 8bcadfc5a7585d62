"""Records in kernels: the form of nodes and messages in compiled code.

A record is a numpy structure of fixed size with fields that kernels read and write by name. An array of any length is
represented by its address and shape, without ownership: `floats`, `integers` and `longs` return the array. A record may
also contain a NamedTuple of arrays and numbers, such as the state of a body in `physics`: `form`, `unpacking`.
"""

from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.np.arrayobj import make_array, populate_array

from palpate.compiler import interpreted
from palpate.compiler.fields import KINDS
from palpate.compiler.kernel import CompiledKernel, kernel
from palpate.compiler.memory import BYTE, INTEGER, intrinsic

MOST = 20  # Maximum number of records of a kernel
RAISED = 1  # Status of a kernel that raised
NUMBERS = {float: types.float64, int: types.int64, bool: types.boolean}


def address(function: CompiledKernel, *dtypes: np.dtype) -> int:
    """Address of the machine code of a kernel for these records and dt [s], for `call`; compiled or loaded if
    necessary. TypeError: numba cannot compile it for these types."""
    if interpreted.ENABLED:
        return interpreted.address(function, *dtypes)
    given = (*map(from_dtype, dtypes), types.float64)
    entry: Any = function.entry
    if given not in entry.overloads:
        entry.compile(given)
    code = entry.overloads[given]
    return code.library.get_pointer_to_function(code.fndesc.llvm_func_name)


@intrinsic(interpreted.invoke)
def _invoke(typing: Any, function: Any, records: Any, count: Any, dt: Any) -> Any:
    """Call machine code at an address with `count` addresses of records and dt: (status, returned boolean).

    numba's calling convention for CPUs: address of the result, address of the exception, arguments.
    """

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


@kernel
def call(function, records, count, dt):
    """Call machine code (`address`) with `count` records, whose addresses are at the address `records`. Returns whether
    it raised, and the boolean that it returned."""
    status, result = _invoke(function, records, count, dt)
    return status != 0, result != 0


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


def array_of(element: str | np.dtype) -> Any:
    """An intrinsic for the array (n,) or (n,m) that a field of a record refers to."""

    @intrinsic(interpreted.array_of(element))
    def array(typing: Any, handle: Any) -> Any:
        form = types.Array(_element(element), handle.typeof("shape").nitems, "C")
        return form(handle), lambda context, builder, _, given: _array(context, builder, form, given[0])

    return array


floats, integers, longs = map(array_of, ("<f8", "<i4", "<i8"))


def form(kind: type) -> np.dtype:
    """The dtype of the record of a NamedTuple of numbers, tuples of numbers, NamedTuples, and arrays with element type
    and number of axes, `Annotated[np.ndarray, "<f8", 2]`."""
    return np.dtype([(name, *_member(hint)) for name, hint in _members(kind)], align=True)


def _members(kind: type) -> list[tuple[str, Any]]:
    return list(get_type_hints(kind, include_extras=True).items())


def _member(hint: Any) -> tuple[Any, ...]:
    if hasattr(hint, "__metadata__"):
        return (np.dtype([("address", "<i8"), ("shape", "<i8", (hint.__metadata__[1],))], align=True),)
    if get_origin(hint) is tuple:
        return "<f8", (len(get_args(hint)),)
    return (KINDS[hint],) if hint in NUMBERS else (form(hint),)


def unpacking(kind: type) -> Any:
    """An intrinsic for kernels that converts a record to its NamedTuple; arrays are those that the record refers to."""

    @intrinsic(interpreted.unpacking(kind))
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
    return types.BaseTuple.from_types([_type(member) for _, member in _members(hint)], hint)


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
        members = [(record.fields[name][1], member) for name, member in _members(hint)]  # type: ignore[index]
    values = [
        _unpack_member(context, builder, member, builder.gep(at, [ir.Constant(INTEGER, offset)]))
        for offset, member in members
    ]
    return context.make_tuple(builder, _type(hint), values)


@intrinsic(interpreted.nth)
def nth(typing: Any, several: Any, place: Any) -> Any:
    """The message with this index of an input that takes several."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = builder.bitcast(arguments[0], INTEGER.as_pointer())
        at = builder.gep(words, [builder.add(arguments[1], ir.Constant(INTEGER, 1))])
        return builder.inttoptr(builder.load(at), context.get_value_type(signature.return_type))

    return several.typeof("like")(several, types.int64), generate


@intrinsic(interpreted.clear)
def clear(typing: Any, record: Any) -> Any:
    """Set all fields of a record to zero."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        size = ir.Constant(INTEGER, signature.args[0].size)
        cgutils.memset(builder, builder.bitcast(arguments[0], BYTE), size, 0)
        return context.get_dummy_value()

    return types.void(record), generate


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
    """Set a vector of variable length to a single number."""
    values.count = 1
    values.values[0] = number


@kernel
def lend(handle, array):
    """Let a field of an output refer to an array of the state."""
    handle.address = array.address
    for axis in range(len(handle.shape)):
        handle.shape[axis] = array.shape[axis]


@kernel
def lend_first(handle, array, count):
    """The same for the first `count` rows of an array, or of the first of several arrays."""
    handle.address, handle.shape[0] = array.address, count
    for axis in range(1, len(handle.shape)):
        handle.shape[axis] = array.shape[len(array.shape) - len(handle.shape) + axis]
