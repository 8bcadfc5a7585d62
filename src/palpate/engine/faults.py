"""Faults of a graph: all are reported at once, each with its place, the value found, and a remedy."""

import difflib
import os
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from palpate.physics.errors import MISUSE, PalpateError

T = TypeVar("T")


@dataclass(frozen=True, order=True)
class Location:
    """A place in a file, with line and column counted from 1, or a command line option. Where an override replaced the
    class of a node, `before` is the place of the original one."""

    file: str = ""
    line: int = 0
    column: int = 0
    before: str = ""

    def __str__(self) -> str:
        return f"{short(self.file)}:{self.line}" if self.line else short(self.file)


NOWHERE = Location()


@dataclass(frozen=True)
class Fault:
    """One fault.

    text   what was found and what was expected
    cure   remedy: the nearest valid name, the valid names, or an instruction
    place  file and line
    node, port, setting, unit  the node, input or setting concerned, and its unit; empty if none
    """

    text: str
    cure: str = ""
    place: Location = NOWHERE
    node: str = ""
    port: str = ""
    setting: str = ""
    unit: str = ""

    def __str__(self) -> str:
        named = (("node", self.node, ""), ("input", self.port, ""), ("setting", self.setting, self.unit))
        about = ", ".join(f"{kind} {name!r}" + (f" [{unit}]" if unit else "") for kind, name, unit in named if name)
        line = ": ".join(part for part in (str(self.place), about, self.text) if part)
        return f"{line}\n  {self.cure}" if self.cure else line

    def to_spec(self) -> dict[str, Any]:
        """Plain data for programs."""
        return asdict(self) | {"place": str(self.place), "file": self.place.file, "line": self.place.line}


class GraphError(PalpateError, ValueError):
    """A graph, scene, placement or launch file cannot be run. `faults` lists all reasons."""

    exit_code = MISUSE

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = list(dict.fromkeys(faults))
        super().__init__("\n".join(map(str, self.faults)))

    @property
    def hint(self) -> str:
        return f"{len(self.faults)} fault{'s' * (len(self.faults) != 1)}."

    def to_spec(self) -> dict[str, Any]:
        return {"faults": [fault.to_spec() for fault in self.faults]}


@dataclass
class Faults:
    """Collected faults, reported together."""

    entries: list[Fault] = field(default_factory=list)

    def add(self, text: str, cure: str = "", place: Location = NOWHERE, **about: str) -> None:
        """Add a fault; `about` names node, port or setting."""
        self.entries.append(Fault(text, cure, place, **about))

    def keep(self, read: Callable[..., T], *given: Any) -> T | None:
        """Return `read(*given)`, or None if it raises a GraphError, whose faults are added."""
        try:
            return read(*given)
        except GraphError as error:
            self.entries.extend(error.faults)
            return None

    def done(self) -> None:
        """Raise GraphError if there is a fault."""
        if self.entries:
            raise GraphError(self.entries)


def nearest(name: str, known: Iterable[str], count: int = 3, likeness: float = 0.6) -> list[str]:
    """The known names most similar to `name`, ignoring case, best first.

    likeness  least similarity, 0 to 1: 0.6 for a hint, 0.8 for typing errors only
    """
    by_lower = {str(k).lower(): str(k) for k in known}
    return [by_lower[k] for k in difflib.get_close_matches(name.lower(), by_lower, n=count, cutoff=likeness)]


def choices(label: str, name: str, known: Iterable[str]) -> str:
    """A remedy that suggests the nearest valid name and lists all: "Did you mean 'a'? Settings: a, b."."""
    names = [str(k) for k in known]
    close = nearest(name, names, 1)
    more = f" and {len(names) - 30} more" if len(names) > 30 else ""
    listed = f"{label}: {', '.join(names[:30]) or 'none'}{more}."
    return f"Did you mean {close[0]!r}? {listed}" if close else listed


def short(file: str) -> str:
    """The path of a file relative to the working directory, if that is shorter."""
    if not os.path.isabs(file):
        return file
    relative = os.path.relpath(file)
    return relative if len(relative) < len(file) and not relative.startswith("../..") else file
