"""NamedTuples with arrays, in kernels: the address of a record (`compiler.fields.form`).

numba passes a NamedTuple by its members, and each array as seven values. The states of bodies and contacts have dozens
of arrays, so that their kernels consisted of copies of them to four fifths, and compiled for twice as long. Here a
kernel gets one address, and reads a number, or an array's address and shape, where it uses it. None of them changes
while a kernel runs, which the code states (`invariant.load`), so that LLVM reads each once, before a loop.

A call from Python writes the members into a record on the stack.
"""

import functools
import hashlib
from typing import Any, get_args, get_origin

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, lower_getattr_generic, models, register_model, unbox
from numba.np.arrayobj import make_array, populate_array

from palpate.compiler.fields import form, members_of
from palpate.compiler.generators.memory import BYTE, INTEGER

NUMBERS = {float: types.float64, int: types.int64, bool: types.boolean}
ELEMENTS: dict[str, Any] = {
    "<f8": types.float64, "<f4": types.float32, "<i8": types.int64, "<i4": types.int32, "|u1": types.uint8,
    "|b1": types.boolean,
}  # fmt: skip
"""Element types of arrays."""


def element_of(element: str | np.dtype) -> Any:
    """numba's type of the elements of an array."""
    return ELEMENTS[element] if isinstance(element, str) else from_dtype(element)


class InRecord(types.Type):  # type: ignore[misc]
    """The type of a NamedTuple in the memory of a record."""

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self.hints = dict(members_of(kind))
        text = f"{kind.__module__}.{kind.__qualname__} {_layout(kind)}"
        super().__init__(f"{kind.__name__}InRecord{hashlib.sha256(text.encode()).hexdigest()[:16]}")


def _layout(kind: type) -> list[Any]:
    """Names, offsets and types of all members."""
    offsets = form(kind).fields
    return [
        (name, offsets[name][1], _layout(hint) if isinstance(type_of(hint), InRecord) else str(type_of(hint)))  # type: ignore[index]
        for name, hint in members_of(kind)
    ]


@functools.cache
def type_of(hint: Any) -> Any:
    """numba's type of a member, or of a NamedTuple."""
    if hasattr(hint, "__metadata__"):
        element, axes = hint.__metadata__
        return types.Array(element_of(element), axes, "C")
    if get_origin(hint) is tuple:
        return types.UniTuple(types.float64, len(get_args(hint)))
    if hint in NUMBERS:
        return NUMBERS[hint]
    if _has_arrays(hint):
        return InRecord(hint)
    return types.BaseTuple.from_types([type_of(member) for _, member in members_of(hint)], hint)


def _has_arrays(kind: type) -> bool:
    return any(
        hasattr(hint, "__metadata__") or (hasattr(hint, "_fields") and _has_arrays(hint))
        for _, hint in members_of(kind)
    )


@functools.cache
def form_of(kind: type) -> Any:
    """The type of a NamedTuple with arrays whose members all have hints of `compiler.fields.form`; None: another."""
    try:
        form(kind)
        return type_of(kind) if _has_arrays(kind) else None
    except Exception:  # hints may be anything, such as a unit, `Annotated[float, "N"]`, or a name that is not defined
        return None


def type_of_value(value: Any) -> Any:
    """The type of a NamedTuple in Python for a kernel, if all members are as their hints state; None: another."""
    found = form_of(type(value))  # type: ignore[arg-type]
    return found if found is not None and _fits(value, found.hints) else None


def _fits(value: Any, hints: dict[str, Any]) -> bool:
    for member, hint in zip(value, hints.values(), strict=True):
        if hasattr(hint, "__metadata__"):
            element, axes = hint.__metadata__
            if type(member) is not np.ndarray or member.ndim != axes or member.dtype != element:
                return False
            if not member.flags.carray:
                return False
        elif hint in NUMBERS:
            if type(member) is not hint:
                return False
        elif get_origin(hint) is tuple:
            if not (type(member) is tuple and len(member) == len(get_args(hint)) and {*map(type, member)} == {float}):
                return False
        elif not (type(member) is hint and _fits(member, dict(members_of(hint)))):
            return False
    return True


@register_model(InRecord)
class _Address(models.OpaqueModel):  # type: ignore[misc]
    """An address of bytes."""


@infer_getattr
class _Members(AttributeTemplate):  # type: ignore[misc]
    key = InRecord

    def generic_resolve(self, owner: InRecord, name: str) -> Any:  # type: ignore[override]
        return type_of(owner.hints[name]) if name in owner.hints else None


@lower_getattr_generic(InRecord)
def _member(context: Any, builder: Any, owner: InRecord, value: Any, name: str) -> Any:
    return read(context, builder, owner.hints[name], _at(builder, value, form(owner.kind).fields[name][1]))  # type: ignore[index]


def _at(builder: Any, address: Any, offset: int) -> Any:
    return builder.gep(address, [ir.Constant(INTEGER, offset)])


def _load(builder: Any, at: Any, offset: int, kind: ir.Type) -> Any:
    """What is at an address and does not change while a kernel runs."""
    found = builder.load(builder.bitcast(_at(builder, at, offset), kind.as_pointer()))
    found.set_metadata("invariant.load", builder.module.add_metadata([]))
    return found


def read(context: Any, builder: Any, hint: Any, at: Any) -> Any:
    """The value of a member at an address."""
    kind = type_of(hint)
    if isinstance(kind, InRecord):
        return at
    if hasattr(hint, "__metadata__"):
        return array(context, builder, kind, [_load(builder, at, 8 * i, INTEGER) for i in range(1 + kind.ndim)])
    if hint in NUMBERS:
        stored = _load(builder, at, 0, context.get_data_type(kind))
        return context.data_model_manager[kind].from_data(builder, stored)
    if get_origin(hint) is tuple:
        members = [(8 * place, float) for place in range(len(get_args(hint)))]
    else:
        offsets = form(hint).fields
        members = [(offsets[name][1], member) for name, member in members_of(hint)]  # type: ignore[index]
    values = [read(context, builder, member, _at(builder, at, offset)) for offset, member in members]
    return context.make_tuple(builder, kind, values)


def array(context: Any, builder: Any, kind: Any, word: list[Any]) -> Any:
    """The array without owner at the address `word[0]`, of the shape of the other words."""
    made, size = make_array(kind)(context, builder), context.get_abi_sizeof(context.get_data_type(kind.dtype))
    steps = [ir.Constant(INTEGER, size)]
    for length in reversed(word[2:]):
        steps.insert(0, builder.mul(steps[0], length))
    populate_array(
        made, data=builder.inttoptr(word[0], made.data.type), shape=word[1:], strides=steps,
        itemsize=ir.Constant(INTEGER, size), meminfo=None,
    )  # fmt: skip
    return made._getvalue()


@unbox(InRecord)
def _from_python(kind: InRecord, value: Any, c: Any) -> Any:
    size = form(kind.kind).itemsize
    memory = cgutils.alloca_once(c.builder, ir.ArrayType(INTEGER, -(-size // 8)))
    failed = cgutils.alloca_once_value(c.builder, cgutils.false_bit)
    held: list[Any] = []
    _write(c, kind.kind, value, c.builder.bitcast(memory, BYTE), failed, held)
    # Through an empty instruction, behind which LLVM does not know the memory: what is written above is invariant
    # below.
    hidden = c.builder.asm(
        ir.FunctionType(BYTE, [BYTE]), "", "=r,0,~{memory}", [c.builder.bitcast(memory, BYTE)], side_effect=True
    )

    def release() -> None:
        for type_, each in held:
            c.context.nrt.decref(c.builder, type_, each)

    return NativeValue(hidden, is_error=c.builder.load(failed), cleanup=release)


def _write(c: Any, kind: type, value: Any, at: Any, failed: Any, held: list[Any]) -> None:
    """Write the members of a NamedTuple of Python to an address."""
    builder, offsets = c.builder, form(kind).fields
    for place, (name, hint) in enumerate(members_of(kind)):
        item, to = c.pyapi.tuple_getitem(value, place), _at(builder, at, offsets[name][1])  # type: ignore[index]
        type_ = type_of(hint)
        if hasattr(hint, "__metadata__") or hint in NUMBERS or not hasattr(hint, "_fields"):
            native = c.unbox(type_, item)
            builder.store(builder.or_(builder.load(failed), native.is_error), failed)
        if hasattr(hint, "__metadata__"):
            made = make_array(type_)(c.context, builder, native.value)
            held.append((type_, native.value))
            words = builder.bitcast(to, INTEGER.as_pointer())
            parts = [builder.ptrtoint(made.data, INTEGER), *cgutils.unpack_tuple(builder, made.shape)]
            for number, part in enumerate(parts):
                builder.store(part, builder.gep(words, [ir.Constant(INTEGER, number)]))
        elif hint in NUMBERS:
            c.context.pack_value(
                builder, type_, native.value, builder.bitcast(to, c.context.get_data_type(type_).as_pointer())
            )
        elif get_origin(hint) is tuple:
            for number, part in enumerate(cgutils.unpack_tuple(builder, native.value)):
                builder.store(part, builder.bitcast(_at(builder, to, 8 * number), ir.DoubleType().as_pointer()))
        else:
            _write(c, hint, item, to, failed, held)
