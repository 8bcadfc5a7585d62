"""The words on each field, read from a message's docstring: lines `name  [unit]  (shape)  text`."""

from __future__ import annotations

import inspect
import re
from typing import NamedTuple

_LINE = re.compile(r"(\w+)\s+\[([^\]]+)\]\s+\(([^)]*)\)\s+(\S.*)")


class Documented(NamedTuple):
    """One field as the docstring has it."""

    name: str
    unit: str
    shape: tuple[int | str, ...]
    about: str


def documented(kind: type) -> list[Documented]:
    """The fields that a message's docstring describes, in its order."""
    lines = map(str.strip, (inspect.getdoc(kind) or "").splitlines())
    found = [match for match in map(_LINE.fullmatch, lines) if match]
    return [Documented(m[1], m[2], _shape(m[3]), m[4]) for m in found]


def _shape(text: str) -> tuple[int | str, ...]:
    parts = [part.strip() for part in text.split(",")]
    return tuple(int(part) if part.isdigit() else part for part in parts if part)
