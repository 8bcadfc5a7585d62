"""The words on each field, read from a message's docstring: lines `name  [unit]  (shape)  text`."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import sys
from typing import NamedTuple

from palpate.messages.base import Message

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
    matches = [match for match in map(_LINE.fullmatch, lines) if match]
    return [Documented(m[1], m[2], _shape(m[3]), m[4]) for m in matches]


def summary(thing: object) -> str:
    """The first sentence of a docstring, in one line."""
    first = " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split())
    return re.split(r"(?<=[.!?]) ", first, maxsplit=1)[0].rstrip(" ,:")


def message_types() -> dict[str, type[Message]]:
    """All message types that ship, by name: those of every file of this folder."""
    package = sys.modules[Message.__module__.rpartition(".")[0]]
    files = [importlib.import_module(f"{package.__name__}.{f.name}") for f in pkgutil.iter_modules(package.__path__)]
    things = (member for file in files for member in vars(file).values() if isinstance(member, type))
    kinds = (member for member in things if issubclass(member, Message) and member is not Message)
    return {kind.__name__: kind for kind in sorted(kinds, key=lambda kind: kind.__name__)}


def _shape(text: str) -> tuple[int | str, ...]:
    parts = [part.strip() for part in text.split(",")]
    return tuple(int(part) if part.isdigit() else part for part in parts if part)
