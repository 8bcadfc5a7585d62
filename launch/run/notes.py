"""Lines for the user about a run, and warnings about them in Python."""

import re
import sys
import warnings
from collections.abc import Iterable, Iterator
from typing import Any

from palpate.physics.errors import PalpateWarning

_NUMBER = re.compile(r"\d+(\.\d+)?(e[+-]?\d+)?")


class RunNote(str):
    """A line for the user.

    node  the node that it is about; "": the run
    time  [s] on the graph's clock when it was reported; 0: before the first tick
    text  the line
    lane  number of the lane of an ensemble, or of the point of a study; None: of neither
    """

    node: str
    time: float
    lane: int | None

    def __new__(cls, text: str, node: str = "", time: float = 0.0, lane: int | None = None) -> "RunNote":
        note = super().__new__(cls, text)
        note.node, note.time, note.lane = node, time, lane
        return note

    def __reduce__(self) -> tuple[Any, ...]:
        return RunNote, (self.text, self.node, self.time, self.lane)

    @property
    def text(self) -> str:
        return str.__str__(self)

    @property
    def kind(self) -> tuple[str, str]:
        """Node and text without its numbers: equal for notes of one kind."""
        return self.node, _NUMBER.sub("#", self)


def first_of_each_kind(notes: Iterable[RunNote]) -> dict[RunNote, int]:
    """The first note of each kind, and the number of notes of this kind."""
    firsts: dict[tuple[str, str], RunNote] = {}
    counts: dict[tuple[str, str], int] = {}
    for note in notes:
        firsts.setdefault(note.kind, note)
        counts[note.kind] = counts.get(note.kind, 0) + 1
    return {note: counts[kind] for kind, note in firsts.items()}


def lines(notes: Iterable[RunNote], what: str = "lane") -> list[str]:
    """One line for the first note of each kind, with its node, its lane, and the number of other lanes. `what`: name
    of a lane."""
    found = []
    for note, count in first_of_each_kind(notes).items():
        where = "" if note.lane is None else f"{what} {note.lane}{f' and {count - 1} more' if count > 1 else ''}"
        head = ", ".join(part for part in (where, note.node) if part)
        found.append(f"{head}: {note}" if head else note.text)
    return found


def write_notes(notes: Iterable[tuple[int, str, str]]) -> dict[int, str]:
    """Text of the notes (lane, node, text) of each lane that has some: a line each, "node: text"."""
    found: dict[int, list[str]] = {}
    for lane, node, text in notes:
        found.setdefault(lane, []).append(f"{node}: {' '.join(text.split())}")
    return {lane: "\n".join(texts) for lane, texts in found.items()}


def read_notes(written: Iterable[tuple[int, str]], time: float) -> Iterator[RunNote]:
    """The notes in texts of `write_notes`, each with its lane. `time` [s]: of the end of the run."""
    for lane, text in written:
        for node, _, line in (each.partition(": ") for each in text.split("\n")):
            yield RunNote(sys.intern(line), node, time, lane)


def warn(notes: Iterable[RunNote], level: int = 3, what: str = "lane") -> None:
    """A PalpateWarning for the first note of each kind. `level`: of the caller to whose line it refers."""
    for line in lines(notes, what):
        warnings.warn(line, PalpateWarning, stacklevel=level)
