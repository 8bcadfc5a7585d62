"""The declaration of a message's fields: name, unit, shape, type."""

import math
import re
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


MOST = {
    "N": (1e4, "1000 times the largest force of a device"),
    "N m": (410.0, "1000 times the largest torque of a device"),
    "m": (1e3, "1000 times the reach of an arm"),
    "m/s": (5e3, "1000 times the fastest motion that kinematics accept"),
    "rad": (1e4, "1000 turns"),
    "rad/s": (1e5, "16 000 turns per second"),
    "N/m": (1e7, "1 mm of a solid of 10 GPa"),
    "Pa": (1e10, "10 kN on 1 mm^2"),
    "J": (1e7, "10 kN over 1 km"),
    "J/m^3": (1e10, "the work of 10 GPa at a strain of 1"),
    "N/m^n": (1e18, "1 kN at 10 um with n = 3"),
    "s/m": (1e6, "Hunt-Crossley damping of a rebound of 1 um/s"),
    "1/m": (1e9, "a radius of curvature of 1 nm"),
    "m^2": (1e6, "the square of 1 km"),
    "m^3": (1e9, "the cube of 1 km"),
    "m^2/N": (1e9, "the square of 1 km per mN"),
    "m^3/N": (1e12, "the cube of 1 km per mN"),
    "s": (1e10, "300 years"),
    "1/s": (1e6, "1000 times the rate of a nerve fibre"),
    "Hz": (1e9, "1 GHz"),
    "1": (1e12, "a ratio of 1 Tm to 1 m"),
}
"""Largest plausible magnitude of a number by SI unit, and the reason. `Bound` changes it for a field."""


class Bound:
    """Marks a field whose largest plausible magnitude is not that of its unit: `Annotated[float, "1", Bound(1.0,
    "a fraction")]`."""

    def __init__(self, most: float, why: str) -> None:
        self.most, self.why = most, why


class MessageError(ValueError):
    """A message does not match its type; names the field, what was found and what is expected."""


class OneOf:
    """Marks a text field whose value is one of these words."""

    def __init__(self, *words: str) -> None:
        self.words = words


@dataclass(frozen=True)
class Field:
    """One field of a message: name, SI unit, shape (letters are lengths found at run time), Python type, dtype, the
    allowed words of a text field that declares them, and the largest plausible magnitude with its reason (infinite for
    a unit without one)."""

    name: str
    unit: str
    shape: Shape
    type: Any
    dtype: np.dtype | None
    words: tuple[str, ...] = ()
    most: float = math.inf
    why: str = ""

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
    bound = next((m for m in marks if isinstance(m, Bound)), None)
    most, why = (bound.most, bound.why) if bound else _most(unit)
    return Field(name, unit, shape, plain, dtype, words, most, why)


def _most(unit: str) -> tuple[float, str]:
    """The bound of a unit, the largest one of a list of units, as in "N (3), 1/m (9)"."""
    units = [re.sub(r" \(\d+\)$", "", part) for part in unit.split(", ")]
    return max(MOST.get(each, (math.inf, "")) for each in units)
