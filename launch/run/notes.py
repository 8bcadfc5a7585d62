"""Lines for the user about a run, and warnings about them in Python."""

import re
import sys
import warnings
from array import array
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, overload

from palpate.launch.run.wire.printable import printable
from palpate.physics.errors import PalpateWarning

if TYPE_CHECKING:
    import numpy as np

GRAPH = "graph"  # instead of a node, in the text of a note about the graph
_NUMBER = re.compile(r"\d+(\.\d+)?(e[+-]?\d+)?")


class RunNote(str):
    """A line for the user. Control characters in its text, which may be that of a file or a device, are shown.

    node  the node that it is about; "": the run
    time  [s] on the graph's clock when it was reported; 0: before the first tick
    text  the line
    lane  number of the lane of an ensemble, or of the point of a study; None: of neither
    """

    node: str
    time: float
    lane: int | None

    def __new__(cls, text: str, node: str = "", time: float = 0.0, lane: int | None = None) -> "RunNote":
        note = super().__new__(cls, printable(text))
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
        return self.node, _without_numbers(self.text)


@lru_cache(maxsize=256)
def _without_numbers(text: str) -> str:
    return _NUMBER.sub("#", text)


class LaneNotes(Sequence[RunNote]):
    """Notes of the lanes of an ensemble, in the order of the lanes. Equal lines are kept once, and 12 bytes for each
    lane that has one.

    time  [s] of all of them: when they are collected
    """

    def __init__(self, time: float = 0.0) -> None:
        self._time, self._numbers = time, dict[tuple[str, str], int]()
        self._places, self._lanes = array("i"), array("q")
        self._order: np.ndarray | None = None

    def add(self, lane: int, node: str, text: str) -> None:
        self._places.append(self._numbers.setdefault((node, text), len(self._numbers)))
        self._lanes.append(lane)
        self._order = None

    def __len__(self) -> int:
        return len(self._lanes)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    @overload
    def __getitem__(self, place: int) -> RunNote: ...
    @overload
    def __getitem__(self, place: slice) -> list[RunNote]: ...
    def __getitem__(self, place: int | slice) -> RunNote | list[RunNote]:
        if self._order is None:
            import numpy as np  # `palpate doctor` runs without it

            self._order = np.argsort(np.array(self._lanes), kind="stable")
            self._texts = list(self._numbers)
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        k = self._order[place]
        node, text = self._texts[self._places[k]]
        return RunNote(text, node, self._time, self._lanes[k])


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
    """Text of the notes (lane, node, text) of each lane that has some: a line each, "node: text", or "graph: text"."""
    found: dict[int, list[str]] = {}
    for lane, node, text in notes:
        found.setdefault(lane, []).append(f"{node or GRAPH}: {' '.join(text.split())}")
    return {lane: sys.intern("\n".join(texts)) for lane, texts in found.items()}


def read_notes(written: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str, str]]:
    """The notes (lane, node, text) in texts of `write_notes`."""
    for lane, text in written:
        for node, _, line in (each.partition(": ") for each in text.split("\n")):
            yield lane, "" if node == GRAPH else node, line


def warn(notes: Iterable[RunNote], level: int = 3, what: str = "lane") -> None:
    """A PalpateWarning for the first note of each kind. `level`: of the caller to whose line it refers."""
    for line in lines(notes, what):
        warnings.warn(line, PalpateWarning, stacklevel=level)
