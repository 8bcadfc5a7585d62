"""Base class of messages: a frozen struct with a header, a unit and a shape for each field, and its wire form.

A message type is declared once, as a class. The checks, the schema of recordings and the axis labels are derived from
its annotations:

    class Friction(Message):
        \"\"\"Tangential force of the finger on the tissue.

        force  [N] (3)  along the sliding velocity of the finger
        stick  [1] ()   true while the contact does not slide
        \"\"\"
        force: Annotated[Vector3, "N"]
        stick: Annotated[bool, "1"]

On the wire a message is one msgpack map from field name to value. Vectors of up to 16 numbers are msgpack arrays of
floats; larger arrays are maps {dtype, shape, data} with raw little-endian bytes.
"""

import operator
import typing
from functools import cache
from typing import Annotated, Any, Self, TypeVar

import msgspec
import numpy as np

from palpate.messages.checks import SETTLE
from palpate.messages.example import example
from palpate.messages.fields import HEADER, Field, Floats, Ints, MessageError, Vector, Vector2, Vector3, fields

__all__ = [
    "HEADER", "NO_FLOATS", "Field", "Floats", "Ints", "Message", "MessageError", "Sparse", "Vector", "Vector2",
    "Vector3", "always_sent", "fields", "pack", "unpack",
]  # fmt: skip


NO_FLOATS = np.zeros(0)
NO_FLOATS.setflags(write=False)  # avoids a copy per message; as a default it is omitted on the wire by identity


@typing.dataclass_transform(frozen_default=True, kw_only_default=False)
class Message(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """Header of every message. The runner fills it in; nodes do not set it.

    tick    [1]  ()   number of the step of the graph's base clock
    time    [ns] ()   time of that tick on the graph's clock
    source  [1]  ()   name of the node that sent it
    used    [1]  (u)  ticks of the inputs that it was computed from, in port order; -1 for a missing input
    delayed [ns] ()   age of its content at `time`: time since the sample, or in a network. Absent: 0. A node that
                      differentiates a position uses it
    """

    tick: Annotated[int, "1"] = -1
    time: Annotated[int, "ns"] = -1
    source: Annotated[str, "1"] = ""
    used: Annotated[tuple[int, ...], "1", ("u",)] = ()
    delayed: Annotated[int | msgspec.UnsetType, "ns"] = msgspec.UNSET

    def __post_init__(self) -> None:
        SETTLE[type(self)](self)

    if typing.TYPE_CHECKING:

        def __copy__(self) -> Self: ...

    @classmethod
    def example(cls, loaded: bool) -> Self:
        """A plausible message, under a light load or at rest, with which the runner warms nodes up. Override it where
        fields depend on one another in ways that their units do not show."""
        return typing.cast(Self, example(cls, loaded))


M = TypeVar("M", bound=Message)


def always_sent(value: Any) -> Any:
    """A default value that is nevertheless sent."""
    return msgspec.field(default_factory=lambda: value)


class Sparse(Message, frozen=True, kw_only=True, omit_defaults=True):
    """A message whose plain default values are omitted on the wire; the header is always sent."""

    tick: Annotated[int, "1"] = always_sent(-1)
    time: Annotated[int, "ns"] = always_sent(-1)
    source: Annotated[str, "1"] = always_sent("")
    used: Annotated[tuple[int, ...], "1", ("u",)] = always_sent(())


LONG_MAP, SHORT_MAP, MOST_SHORT = 0xDE, 0x80, 15  # msgpack: of up to 65 535 entries, of up to 15


def pack(message: Message) -> bytes:
    """The wire form: one msgpack map with the shortest header, so that a field that is omitted changes no byte.
    (msgspec takes a header that would do for all fields.)"""
    data = _ENCODER.encode(message)
    if data[0] == LONG_MAP and data[1] == 0 and data[2] <= MOST_SHORT:
        return bytes((SHORT_MAP | data[2],)) + data[3:]
    return data


@cache
def decoder(kind: type) -> msgspec.msgpack.Decoder:
    """The decoder of `unpack`, cached. Its errors do not name the message type."""
    return msgspec.msgpack.Decoder(kind, dec_hook=_decode_array)


def unpack(data: bytes, kind: type[M]) -> M:
    """The message of type `kind` in the bytes; its arrays are read-only views of them.

    MessageError: not msgpack, or not a message of this type; names the field.
    """
    try:
        return decoder(kind).decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"not a {kind.__name__} of {len(data)} bytes: {error}") from None


_dtype_name = cache(operator.attrgetter("str"))


def _encode_array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"dtype": _dtype_name(value.dtype), "shape": value.shape, "data": value.tobytes()}
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"{type(value).__name__} cannot be sent in a message")


def _decode_array(kind: type, value: Any) -> Any:
    try:
        dtype = np.dtype(value["dtype"])
        if dtype.kind not in "fiu":
            raise ValueError(f"dtype {value['dtype']!r}, expected numbers")
        return np.frombuffer(value["data"], dtype=dtype).reshape(value["shape"])
    except (KeyError, TypeError, ValueError, OverflowError, SyntaxError) as error:  # numpy parses type names
        raise ValueError(f"expected an array as {{dtype, shape, data}}: {error}") from None


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encode_array)
