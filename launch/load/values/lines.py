"""Checks a YAML mapping against a struct: types, units and limits by msgspec, errors with the field's description."""

import typing
from collections.abc import Iterator
from functools import cache
from typing import Any, TypeVar

import msgspec

from palpate.engine.faults import Faults, choices
from palpate.launch.load.values.source import YamlSource
from palpate.messages.wording import words_of, written
from palpate.units.quantity import UnitError, convert

BOOLEAN = "YAML reads on, off, yes and no as true and false. Put a name in quotes: 'on'."
ALIASES = {"over": "vary", "vary": "over"}  # what varies, in a study and in an experiment
Line = TypeVar("Line", bound=msgspec.Struct)


def quantity(unit: str, least: float, most: float) -> msgspec.Meta:
    """Annotation of a field that is a number in this unit, or a text with another unit of the same dimension."""
    return msgspec.Meta(
        ge=least, le=most, description=f"a number above 0, from {least:g} to {most:g}", extra={"unit": unit}
    )


def fill(kind: type[Line], line: YamlSource, faults: Faults, within: str = "", **about: str) -> Line | None:
    """The struct of a mapping. Each unknown key, invalid value and missing value is a fault with its place; the field
    then keeps its default. None: a field without default has no value.

    within  name of the mapping, "group 'loop'", if the place does not say it
    about   node or port for the faults
    """
    known = _fields(kind)
    missing = {key: None for key, field in known.items() if field.required and key not in line.data}
    given, refused = {}, False
    for key, value in (line.data | missing).items():
        place = line.place(key)
        if key not in known:
            text = f"{within}: unknown key {key!r}" if within else f"unknown key {key!r}"
            other = ALIASES.get(key)
            cure = f"It is {other!r} here." if other in known else choices("Keys", key, known)
            faults.add(text, cure, place, **about)
            continue
        field = known[key]
        meta = next(_marks(field.type), msgspec.Meta())
        unit = (meta.extra or {}).get("unit")
        name = f"{within}, {key}" if within else key
        try:
            number = convert(value, unit) if unit and isinstance(value, str) else value
            given[field.name] = msgspec.convert(number, field.type)
        except UnitError as error:
            faults.add(f"{name} [{unit}]: {error}", "", place, **about)
        except msgspec.ValidationError:
            expected = f", expected {meta.description}" if meta.description else ""
            words = words_of(field.type)
            cure = choices(f"{key.capitalize()}s", str(value), words) if words else ""
            if isinstance(value, bool) and str in typing.get_args(field.type):
                cure = f"{cure} {BOOLEAN}".strip()
            found = "missing" if value is None else f"found {written(value)}"
            text = f"{name}{f' [{unit}]' if unit else ''}: {found}{expected}"
            faults.add(text, cure, place, **about)
        refused |= field.required and field.name not in given
    return None if refused else kind(**given)


@cache
def _fields(kind: type[msgspec.Struct]) -> dict[str, msgspec.structs.FieldInfo]:
    return {field.encode_name: field for field in msgspec.structs.fields(kind)}


def _marks(hint: Any) -> Iterator[msgspec.Meta]:
    """The annotations of a type that have a description, the outermost first."""
    parts = typing.get_args(hint)
    yield from (part for part in parts if isinstance(part, msgspec.Meta) and part.description)
    for part in parts:
        yield from _marks(part)
