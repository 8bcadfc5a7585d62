"""What is wrong with a graph: all faults at once, each with its place, what was found and what would work."""

import difflib
import os
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from palpate.physics.errors import MISUSE, PalpateError

T = TypeVar("T")


@dataclass(frozen=True, order=True)
class Location:
    """Where something is written: a file with line and column counted from 1, or a command line option. `before`: where
    the line of a node says it, into which another class was put at this place."""

    file: str = ""
    line: int = 0
    column: int = 0
    before: str = ""

    def __str__(self) -> str:
        return f"{short(self.file)}:{self.line}" if self.line else short(self.file)


NOWHERE = Location()


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    text   what was found and what was expected
    cure   what would work: the nearest valid name, the valid names, or what to do
    place  file and line
    node, port, setting  what it is about, where it is about one; unit: that of the setting
    """

    text: str
    cure: str = ""
    place: Location = NOWHERE
    node: str = ""
    port: str = ""
    setting: str = ""
    unit: str = ""

    def __str__(self) -> str:
        about = []
        if self.node:
            about.append(f"node {self.node!r}")
        if self.port:
            about.append(f"input {self.port!r}")
        if self.setting:
            about.append(f"setting {self.setting!r}" + (f" [{self.unit}]" if self.unit else ""))
        head = ", ".join(about)
        line = ": ".join(part for part in (str(self.place), head, self.text) if part)
        return f"{line}\n  {self.cure}" if self.cure else line

    def to_spec(self) -> dict[str, Any]:
        """Plain data for programs."""
        return asdict(self) | {"place": str(self.place), "file": self.place.file, "line": self.place.line}


class GraphError(PalpateError, ValueError):
    """A graph, scene, placement or launch file that cannot be run. `faults` holds all that is wrong with it."""

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
    """Collects faults, so that all of them are reported at once."""

    entries: list[Fault] = field(default_factory=list)

    def add(self, text: str, cure: str = "", place: Location = NOWHERE, **about: str) -> None:
        """Note one fault; `about` names node, port or setting."""
        self.entries.append(Fault(text, cure, place, **about))

    def keep(self, read: Callable[..., T], *given: Any) -> T | None:
        """What `read(*given)` gives; None if it raises a GraphError, whose faults are noted."""
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
    """The known names that are most like `name`, best first, upper and lower case alike.

    likeness  0 to 1, how like they must be: 0.6 for a hint, 0.8 where only a slip of the pen counts
    """
    by_lower = {str(k).lower(): str(k) for k in known}
    return [by_lower[k] for k in difflib.get_close_matches(name.lower(), by_lower, n=count, cutoff=likeness)]


def choices(label: str, name: str, known: Iterable[str]) -> str:
    """A cure that lists the valid names, the nearest first: "Did you mean 'a'? Settings: a, b."."""
    names = [str(k) for k in known]
    close = nearest(name, names, 1)
    listed = f"{label}: {', '.join(names[:30])}{', ...' if len(names) > 30 else ''}." if names else f"{label}: none."
    return f"Did you mean {close[0]!r}? {listed}" if close else listed


def short(file: str) -> str:
    """A file as seen from the working directory, where that is shorter."""
    if not os.path.isabs(file):
        return file
    relative = os.path.relpath(file)
    return relative if len(relative) < len(file) and not relative.startswith("../..") else file
