"""Errors of msgspec in the words of a user: what a value of a YAML file should be."""

import re
import typing
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

KINDS = {
    "float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false", "null": "null",
    "array": "a list", "object": "a mapping",
}  # fmt: skip
_EXPECTED = re.compile(r"Expected (.+?)(?:, got .+?)?(?: - at (.+))?")
_KEY = re.compile(r"Object (contains unknown field|missing required field) (\w+)(?: - at (.+))?")


def written(value: Any) -> str:
    """A value as a YAML file has it, for an error: null, true, 3, 'a text', [1, 2], {key: value}."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {written(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(written, value))}]"
    return repr(value)


def reword(error: msgspec.ValidationError, hint: Any) -> str:
    """What the error of a value of this type expects: "expected a number > 0"."""
    text = str(error).replace("`", "")
    if match := _KEY.fullmatch(text):
        what = "unknown key" if "unknown" in match[1] else "missing key"
        keys = [field.encode_name for kind in _structs(hint) for field in msgspec.structs.fields(kind)]
        return f"{what} {match[2]!r}{_place(match[3])}; expected {', '.join(keys)}"
    if "enum" in text and (words := words_of(hint)):
        return f"expected {' or '.join(map(str, words))}"
    if match := _EXPECTED.fullmatch(text):
        return f"expected {' or '.join(map(_kind, match[1].split(' | ')))}{_place(match[2])}"
    return text


def words_of(hint: Any) -> tuple[str, ...]:
    """The words of a Literal type; otherwise empty."""
    parts = typing.get_args(hint)
    if typing.get_origin(hint) is typing.Literal:
        return parts
    return next((words for part in parts if (words := words_of(part))), ())


def _place(path: str | None) -> str:
    return f" at {path.removeprefix('$').lstrip('.')}" if path and path != "$" else ""


def _kind(text: str) -> str:
    """A type of msgspec with its limit: "float > 0.0", "array of length 3"."""
    name, _, limit = text.strip().partition(" ")
    kind = KINDS.get(name, name)
    if limit.startswith("of length"):
        return f"{kind} of {limit.removeprefix('of length').strip()}"
    return f"{kind} {limit.removesuffix('.0')}".strip()


def _structs(hint: Any) -> Iterator[type[msgspec.Struct]]:
    """The structs in a type."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        yield hint
    for part in typing.get_args(hint):
        yield from _structs(part)
