"""The declaration of a message's fields: name, unit, shape, type."""

import typing
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np

Vector = tuple[float, ...]
Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]
Floats = Annotated[np.ndarray, np.dtype("<f8")]
Ints = Annotated[np.ndarray, np.dtype("<i4")]
Shape = tuple[int | str, ...]
HEADER = ("tick", "time", "source", "used", "delayed")


class MessageError(ValueError):
    """A message does not match its type; names the field, what was found and what is expected."""


class OneOf:
    """Marks a text field whose value is one of these words."""

    def __init__(self, *words: str) -> None:
        self.words = words


@dataclass(frozen=True)
class Field:
    """One field of a message: name, SI unit, shape (letters are lengths found at run time), Python type, dtype, and the
    allowed words of a text field that declares them."""

    name: str
    unit: str
    shape: Shape
    type: Any
    dtype: np.dtype | None
    words: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name and unit, as on the axis of a plot: `force [N]`."""
        return f"{self.name} [{self.unit}]"

    @property
    def element(self) -> Any:
        """Python type of the numbers of a vector; None if there are several."""
        found = set(typing.get_args(self.type)) - {Ellipsis}
        return found.pop() if len(found) == 1 else None


@cache
def fields(kind: Any) -> tuple[Field, ...]:
    """The declared fields of a message type, without the header, in order of declaration.

    TypeError: a field has no unit, or an array no shape.
    """
    hints = typing.get_type_hints(kind, include_extras=True)
    return tuple(_field(kind, name, hints[name]) for name in kind.__struct_fields__ if name not in HEADER)


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
    words = next((m.words for m in marks if isinstance(m, OneOf)), ())
    return Field(name, unit, shape, plain, dtype, words)
