"""The description of each field, read from a message's docstring: lines `name  [unit]  (shape)  text`.

Further lines of a text are indented more than the names.
"""

import inspect
import re
import sys
from typing import NamedTuple

from palpate.messages.base import Message
from palpate.registry import classes, declared_classes, registered_modules

_CONTINUED = re.compile(r"(?<=\S)\n +(?=\S)")
_LINE = re.compile(r"(\w+)\s+\[([^\]]+)\]\s+\(([^)]*)\)\s+(\S.*)")


class Documented(NamedTuple):
    """One field as the docstring describes it."""

    name: str
    unit: str
    shape: tuple[int | str, ...]
    about: str


def documented_fields(kind: type) -> list[Documented]:
    """The fields that a message's docstring describes, in its order."""
    text = _CONTINUED.sub(" ", inspect.getdoc(kind) or "")
    matches = [match for match in map(_LINE.fullmatch, text.splitlines()) if match]
    shapes = ([int(part) if part.isdigit() else part for part in re.findall(r"[^\s,]+", m[3])] for m in matches)
    return [Documented(m[1], m[2], tuple(shape), m[4]) for m, shape in zip(matches, shapes, strict=True)]


def summary(thing: object) -> str:
    """The first sentence of a docstring, on one line."""
    first = " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split())
    return re.split(r"(?<=[.!?]) ", first, maxsplit=1)[0].rstrip(" ,:")


def message_types() -> dict[str, type[Message]]:
    """All message types by name: from every file of this folder, and those that other distributions register."""
    others = registered_modules("palpate.messages")[0].values()
    kinds = {kind.__name__: kind for module in others for kind in declared_classes(module, Message)}
    kinds |= classes(sys.modules[Message.__module__.rpartition(".")[0]], Message)
    return {name: kinds[name] for name in sorted(kinds) if kinds[name] is not Message}
