"""Messages as records: the fixed memory layout in which compiled nodes read and write them.

A record begins with the header:

    there    whether the record contains a message; if not, all other fields are undefined
    tick     as in the message
    time     as in the message [ns]
    present  the inputs that its sender had, as a bit mask in port order: bit n for entry n of `used`
    delayed  as in the message [ns]; 0: absent

The fields follow by name: numbers, flags and vectors of fixed length unchanged; a word as its index among the words of
the field (`OneOf`); a vector of open length, of at most `ROOM` numbers, as `count` and `values`; an array as `address`
and `shape` in the sender's memory.
"""

import ctypes
import math
import struct
from collections.abc import Callable, Collection
from functools import cache
from typing import Any

import msgspec
import numpy as np

from palpate.messages.base import Message
from palpate.messages.fields import Field, MessageError, fields

ROOM = 16
"""Capacity of a vector of open length, which is sent as a msgpack array of numbers."""
HEAD = [("there", "?"), ("tick", "<i8"), ("time", "<i8"), ("present", "<i8"), ("delayed", "<i8")]
KINDS = {float: "<f8", int: "<i8", bool: "?"}
CODES = {"f": "d", "i": "q", "b": "?"}
ARRAYS = ("<f8", "<i4")  # dtypes of arrays that kernels read


@cache
def layout(kind: type[Message]) -> np.dtype:
    """The record layout of a message type. TypeError: a field that a record cannot contain; says what would do."""
    return np.dtype(HEAD + [(field.name, _kind(kind, field)) for field in fields(kind)], align=True)


def blank(kind: type[Message]) -> np.ndarray:
    """A record (1,) without a message; its arrays are empty."""
    return _blank(kind).copy()


@cache
def _blank(kind: type[Message]) -> np.ndarray:
    record = np.zeros(1, layout(kind))
    for field in fields(kind):
        if field.dtype is not None:
            record[field.name]["shape"] = _empty(kind, field).shape
    return record


def array_handle(ndim: int) -> np.dtype:
    """The entry of a record for an array with `ndim` axes."""
    return np.dtype([("address", "<i8"), ("shape", "<i8", (ndim,))], align=True)


def _kind(kind: type, field: Field) -> Any:
    if field.dtype is not None and field.dtype.str in ARRAYS:
        return array_handle(len(field.shape))
    if field.dtype is None and field.shape and (element := KINDS.get(field.element)):
        if isinstance(field.shape[0], int):
            return element, field.shape
        return np.dtype([("count", "<i8"), ("values", element, (ROOM,))], align=True)
    if field.words:
        return KINDS[int]
    if not field.shape and field.type in KINDS:
        return KINDS[field.type]
    found = field.dtype if field.dtype is not None else getattr(field.type, "__name__", field.type)
    raise TypeError(
        f"{kind.__name__}.{field.name}: a compiled node cannot hold {found}. Numbers, flags, vectors of them, arrays "
        'that are Floats or Ints can be held, and words from a list: Annotated[str, "1", OneOf("free", "contact")]'
    )


@cache
def writer(kind: type[Message], names: Collection[str]) -> Callable[[Message, Any], None]:
    """A function (message, memory of a record) that writes the header and the fields `names` of a message."""
    record = layout(kind)
    given = ["True", "m.tick", "m.time", "present(m.used)", "m.delayed or 0"]
    format_, filled = "=?7xqqqq", 40
    known: dict[str, Any] = {"address": address_of, "present": _present}
    for field in fields(kind):
        if field.name not in names:
            continue
        dtype, offset = record.fields[field.name][:2]  # type: ignore[index]
        format_ += f"{offset - filled}x{_codes(dtype)}"
        filled = offset + dtype.itemsize
        given += _values(field, known)
    packed = struct.Struct(format_)
    assert packed.size <= record.itemsize
    known["pack_into"] = packed.pack_into
    exec(f"def write(m, memory):\n    pack_into(memory, 0, {', '.join(given)})", known)
    return known["write"]


def _values(field: Field, known: dict[str, Any]) -> list[str]:
    """Expressions of the numbers of a field; the names in them are added to `known`."""
    value = f"m.{field.name}"
    if field.dtype is not None:
        return [f"address({value})", f"*{value}.shape"]
    if field.words:
        known[f"words_{field.name}"] = _Words({word: place for place, word in enumerate(field.words)})
        return [f"words_{field.name}[{value}]"]
    if field.shape and not isinstance(field.shape[0], int):
        known |= {"rest": (0,) * ROOM, "too_many": _too_many}
        count = f"len({value})"
        return [f"{count} if {count} <= {ROOM} else too_many(m, {field.name!r})", f"*({value} + rest)[:{ROOM}]"]
    return [f"*{value}" if field.shape else value]


@cache
def reader(kind: type[Message]) -> Callable[[Any], Message]:
    """A function (memory of a record) that returns the message; of its header it sets tick, time and delayed. Arrays
    are copied."""
    record = layout(kind)
    format_, filled, at, given = "=?7xqqqq", 40, 5, ["tick=v[1]", "time=v[2]", "delayed=v[4] or UNSET"]
    known: dict[str, Any] = {"kind": kind, "copied": _copy_array, "UNSET": msgspec.UNSET}
    for field in fields(kind):
        dtype, offset = record.fields[field.name][:2]  # type: ignore[index]
        codes = _codes(dtype)
        format_ += f"{offset - filled}x{codes}"
        filled = offset + dtype.itemsize
        count = len(struct.unpack(f"={codes}", bytes(struct.calcsize(f"={codes}"))))
        if field.dtype is not None:
            known[f"empty_{field.name}"] = _empty(kind, field)
            value = f"copied(v[{at}], v[{at + 1}:{at + count}], empty_{field.name})"
        elif field.words:
            known[f"words_{field.name}"] = field.words
            value = f"words_{field.name}[v[{at}]]"
        elif field.shape and not isinstance(field.shape[0], int):
            value = f"v[{at + 1}:{at + 1} + v[{at}]]"
        else:
            value = f"v[{at}:{at + count}]" if field.shape else f"v[{at}]"
        given.append(f"{field.name}={value}")
        at += count
    known["unpack_from"] = struct.Struct(format_).unpack_from
    exec(f"def read(memory):\n    v = unpack_from(memory)\n    return kind({', '.join(given)})", known)
    return known["read"]


def _codes(dtype: np.dtype) -> str:
    """Format codes of a field's numbers for `struct`."""
    if dtype.fields is not None:
        return "".join(_codes(dtype.fields[name][0]) for name in dtype.names or ())
    base, shape = dtype.subdtype or (dtype, ())
    return f"{math.prod(shape)}{CODES[base.kind]}"


class _Words(dict[str, int]):
    """Index of each allowed word. MessageError: any other word."""

    def __missing__(self, word: str) -> int:
        raise MessageError(f"found the word {word!r}, expected one of {', '.join(map(repr, self))}")


def _too_many(message: Message, name: str) -> int:
    found = len(getattr(message, name))
    raise MessageError(f"{type(message).__name__}.{name}: found {found} numbers; a compiled node takes {ROOM} at most")


def address_of(array: np.ndarray) -> int:
    """Address of the first byte of an array."""
    return array.__array_interface__["data"][0]


def _present(used: tuple[int, ...]) -> int:
    return (1 << len(used)) - 1 if -1 not in used else sum(1 << place for place, tick in enumerate(used) if tick >= 0)


def _empty(kind: type[Message], field: Field) -> np.ndarray:
    """The empty array of a field: its default, which is omitted on the wire, or an array without rows."""
    default = msgspec.structs.fields(kind)[kind.__struct_fields__.index(field.name)].default
    if isinstance(default, np.ndarray):
        return default
    empty = np.zeros([0 if isinstance(length, str) else length for length in field.shape], field.dtype)
    empty.setflags(write=False)
    return empty


def _copy_array(address: int, shape: tuple[int, ...], empty: np.ndarray) -> np.ndarray:
    count = math.prod(shape)
    if not count:
        return empty
    return np.frombuffer(ctypes.string_at(address, count * empty.itemsize), empty.dtype).reshape(shape)
