"""What every message is: a frozen struct with a header, a unit and a shape on each field, and its wire form.

A message is declared once, as a class; its annotations are the truth from which the checks, the log's schema and
the axis labels come:

    class Friction(Message):
        \"\"\"Tangential force on the fingertip.

        force  [N] (3)  along the sliding velocity of the finger
        stick  [1] ()   true while the contact does not slide
        \"\"\"
        force: Annotated[Vector3, "N"]
        stick: Annotated[bool, "1"]

On the wire a message is one msgpack map from field name to value. Vectors of up to 16 numbers are msgpack arrays of
floats; larger arrays are maps {dtype, shape, data} with raw little-endian bytes.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

Vector = tuple[float, ...]
Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]
Floats = Annotated[np.ndarray, np.dtype("<f8")]
Ints = Annotated[np.ndarray, np.dtype("<i4")]
Shape = tuple[int | str, ...]


class MessageError(ValueError):
    """A message that does not hold what its type declares; says which field, what was found, what is expected."""


@typing.dataclass_transform(frozen_default=True, kw_only_default=False)
class Message(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Header of every message; the runner fills it in, nodes leave it alone.

    tick    [1]  ()   number of the step of the graph's base clock
    time    [ns] ()   time of that tick on the graph's clock
    source  [1]  ()   name of the node that sent it
    used    [1]  (u)  ticks of the inputs that it was computed from, in port order; -1 where there was none
    """

    tick: Annotated[int, "1"] = -1
    time: Annotated[int, "ns"] = -1
    source: Annotated[str, "1"] = ""
    used: Annotated[tuple[int, ...], "1", ("u",)] = ()

    def __post_init__(self) -> None:
        _settle(type(self))(self)


M = TypeVar("M", bound=Message)
HEADER = ("tick", "time", "source", "used")


@dataclass(frozen=True)
class Field:
    """One field of a message: name, SI unit, shape (letters are lengths found at run time), Python type, dtype."""

    name: str
    unit: str
    shape: Shape
    type: Any
    dtype: np.dtype | None

    @property
    def label(self) -> str:
        """Name and unit as they stand beside an axis, `force [N]`."""
        return f"{self.name} [{self.unit}]"


_FIELDS: dict[type, tuple[Field, ...]] = {}
_SETTLE: dict[type, Callable[[Any], None]] = {}
_DECODERS: dict[type, msgspec.msgpack.Decoder] = {}


def fields(kind: type[Message]) -> tuple[Field, ...]:
    """The declared fields of a message type, without the header, in order of declaration.

    TypeError: a field lacks its unit, or an array its shape.
    """
    known = _FIELDS.get(kind)
    if known is None:
        hints = typing.get_type_hints(kind, include_extras=True)
        known = tuple(_field(kind, name, hints[name]) for name in kind.__struct_fields__ if name not in HEADER)
        _FIELDS[kind] = known
    return known


def _field(kind: type, name: str, hint: Any) -> Field:
    marks = list(getattr(hint, "__metadata__", ()))
    plain = typing.get_args(hint)[0] if marks else hint
    unit = next((m for m in marks if isinstance(m, str)), None)
    shape = next((m for m in marks if isinstance(m, tuple)), None)
    dtype = next((m for m in marks if isinstance(m, np.dtype)), None)
    if unit is None:
        raise TypeError(f"{kind.__name__}.{name}: no unit; write Annotated[type, unit, shape]")
    if shape is None and typing.get_origin(plain) is tuple and Ellipsis not in typing.get_args(plain):
        shape = (len(typing.get_args(plain)),)
    if shape is None:
        if plain is np.ndarray or typing.get_origin(plain) is tuple:
            raise TypeError(f"{kind.__name__}.{name}: no shape; write Annotated[type, unit, shape]")
        shape = ()
    return Field(name, unit, shape, plain, dtype)


def pack(message: Message) -> bytes:
    """The wire form: one msgpack map."""
    return _ENCODER.encode(message)


def unpack(data: bytes, kind: type[M]) -> M:
    """The message of type `kind` that the bytes hold; arrays are read-only views of them.

    MessageError: not msgpack, or not a message of this type; names the field.
    """
    decoder = _DECODERS.get(kind)
    if decoder is None:
        decoder = _DECODERS[kind] = msgspec.msgpack.Decoder(kind, dec_hook=_decode_array)
    try:
        return decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"not a {kind.__name__} of {len(data)} bytes: {error}") from None


def check_finite(message: Message) -> None:
    """Refuse NaN and infinity in any field.

    MessageError: names the field, the place in it and the value.
    """
    for field in fields(type(message)):
        value = getattr(message, field.name)
        if field.dtype is None:
            found = value if isinstance(value, tuple) else (value,) if isinstance(value, float) else ()
            if all(map(math.isfinite, found)):
                continue
        elif np.isfinite(value).all():
            continue
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(np.asarray(value)))[0])
        bad = float(np.asarray(value)[place])
        where = f" at index {place if len(place) > 1 else place[0]}" if place else ""
        raise MessageError(
            f"{type(message).__name__}.{field.name} [{field.unit}]: found {bad}{where}, expected a finite number"
        )


def _encode_array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"dtype": value.dtype.str, "shape": value.shape, "data": value.data if value.size else b""}
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"{type(value).__name__} cannot travel in a message")


def _decode_array(kind: type, value: Any) -> Any:
    try:
        dtype = np.dtype(value["dtype"])
        if dtype.kind not in "fiu":
            raise ValueError(f"dtype {value['dtype']!r}, expected numbers")
        return np.frombuffer(value["data"], dtype=dtype).reshape(value["shape"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"expected an array as {{dtype, shape, data}}: {error}") from None


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encode_array)


def _settle(kind: type[Message]) -> Callable[[Any], None]:
    """The check of a new message, made once per type: vectors become tuples of the declared length, arrays become
    read-only, contiguous, of the declared dtype and shape. A sender may so go on using its own buffers."""
    known = _SETTLE.get(kind)
    if known is None:
        arrays = [f for f in fields(kind) if f.dtype is not None]
        scalars = [f for f in fields(kind) if f.type is float]
        vectors = [
            (f, f.shape[0] if isinstance(f.shape[0], int) else None, _element(f))
            for f in fields(kind)
            if f.dtype is None and f.shape
        ]

        def known(message: Any) -> None:
            for field in scalars:
                value = getattr(message, field.name)
                if type(value) is not float:
                    msgspec.structs.force_setattr(message, field.name, _number(kind, field, value))
            for field, length, element in vectors:
                value = getattr(message, field.name)
                settled = type(value) is tuple and {*map(type, value)} <= element and length in (None, len(value))
                if not settled:
                    msgspec.structs.force_setattr(message, field.name, _tuple(kind, field, value))
            if arrays:
                lengths: dict[str, int] = {}
                for field in arrays:
                    value = _array(kind, field, getattr(message, field.name), lengths)
                    msgspec.structs.force_setattr(message, field.name, value)

        _SETTLE[kind] = known
    return known


def _element(field: Field) -> set[type]:
    """The Python type of a vector's numbers."""
    return {next(t for t in typing.get_args(field.type) if t is not Ellipsis)}


def _number(kind: type, field: Field, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise MessageError(f"{kind.__name__}.{field.name}: found {value!r}, expected a number [{field.unit}]") from None


def _tuple(kind: type, field: Field, value: Any) -> Vector:
    try:
        found = tuple(map(int if _element(field) == {int} else float, value))
    except (TypeError, ValueError):
        raise MessageError(
            f"{kind.__name__}.{field.name}: found {value!r}, expected {field.shape} numbers [{field.unit}]"
        ) from None
    if isinstance(field.shape[0], int) and len(found) != field.shape[0]:
        raise MessageError(
            f"{kind.__name__}.{field.name}: found {len(found)} numbers, expected {field.shape[0]} [{field.unit}]"
        )
    return found


def _array(kind: type, field: Field, value: Any, lengths: dict[str, int]) -> np.ndarray:
    try:
        if isinstance(value, np.ndarray) and not value.flags.writeable and value.dtype == field.dtype:
            found = np.ascontiguousarray(value)
        else:
            found = np.array(value, dtype=field.dtype, order="C")
    except (TypeError, ValueError):
        raise MessageError(f"{kind.__name__}.{field.name}: not an array of {field.dtype} [{field.unit}]") from None
    fits = found.ndim == len(field.shape) and all(
        length == (lengths.setdefault(want, length) if isinstance(want, str) else want)
        for want, length in zip(field.shape, found.shape, strict=True)
    )
    if not fits:
        want = tuple(lengths.get(s, s) if isinstance(s, str) else s for s in field.shape)
        raise MessageError(f"{kind.__name__}.{field.name}: found shape {found.shape}, expected {want} [{field.unit}]")
    found.flags.writeable = False
    return found
