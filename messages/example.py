"""An example message, generated from the declaration of its fields; nodes are warmed up with it before a run."""

import typing
from functools import cache
from typing import Any

import msgspec
import numpy as np

from palpate.messages.fields import Field, fields

TYPICAL = {"m": 1e-3, "m/s": 1e-2, "s": 1e-3, "rad": 0.1, "N": 0.1, "N m": 1e-3, "Pa": 1e3, "m^2": 1e-5, "J": 1e-4}
"""Typical magnitude in a touch, by SI unit; 1 for all others."""
OPEN = 3  # length of a vector of open length


def example(kind: type, loaded: bool) -> Any:
    """A plausible message of this type.

    loaded  True: a light touch, typical numbers for each unit, arrays of one row. False: all zero, arrays empty

    A vector of three numbers with the unit 1 is a direction. TypeError: a field of another type without a default.
    """
    optional = _optional(kind)
    return kind(**{f.name: _value(f, loaded) for f in fields(kind) if _plain(f) or f.name not in optional})


@cache
def _optional(kind: type) -> frozenset[str]:
    return frozenset(field.name for field in msgspec.structs.fields(kind) if not field.required)


def _plain(field: Field) -> bool:
    return field.dtype is not None or field.type in (float, int, bool, str) or typing.get_origin(field.type) is tuple


def _value(field: Field, loaded: bool) -> Any:
    number = TYPICAL.get(field.unit, 1.0) if loaded else 0.0
    if field.dtype is not None:
        shape = tuple(length if isinstance(length, int) else int(loaded) for length in field.shape)
        return np.full(shape, number if field.dtype.kind == "f" else 0, field.dtype)
    if field.type is float:
        return number
    if field.words:
        return field.words[int(loaded) % len(field.words)]
    if field.type in (int, bool, str):
        return field.type(loaded) if field.type is bool else field.type()
    if not _plain(field):
        raise TypeError(f"{field.name}: no example of a {field.type}")
    length = field.shape[0] if isinstance(field.shape[0], int) else OPEN
    if length == 3 and field.unit == "1":
        return (0.0, 0.0, 1.0)
    return (number,) * length
