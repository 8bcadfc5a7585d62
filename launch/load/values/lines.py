"""A line of YAML checked against a struct: types and limits by msgspec, told with the field's description."""

from __future__ import annotations

import typing
from typing import TypeVar

import msgspec

from palpate.engine.faults import Faults, choices
from palpate.launch.load.values.source import YamlSource

Line = TypeVar("Line", bound=msgspec.Struct)


def fill(kind: type[Line], line: YamlSource, about: str, faults: Faults) -> Line:
    """The struct that a mapping says. Each key that it does not have, and each value that does not fit, is a fault with
    its place; the field keeps its default then."""
    hints = typing.get_type_hints(kind, include_extras=True)
    given = {}
    for key, value in line.data.items():
        if key not in hints:
            faults.add(f"{about}: unknown key {key!r}", choices("Keys", key, hints), line.place(key))
        elif value is not None:
            try:
                given[key] = msgspec.convert(value, hints[key])
            except msgspec.ValidationError:
                expected, cure = _expected(hints[key], key, value)
                faults.add(f"{about}, {key}: found {value!r}{expected}", cure, line.place(key))
    return kind(**given)


def _expected(hint: object, key: str, value: object) -> tuple[str, str]:
    """What a field takes, by its description; of a word, those that it may be."""
    if typing.get_origin(hint) is typing.Literal:
        return "", choices(f"{key.capitalize()}s", str(value), typing.get_args(hint))
    (meta,) = (mark for mark in typing.get_args(hint) if isinstance(mark, msgspec.Meta))
    return f", expected {meta.description}", ""
