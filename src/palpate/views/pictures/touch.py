"""Reads the streams of a touch from a recording by message type, independent of the graph's names."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.imports import full_name, recorded_class
from palpate.messages import Contact, Force, Friction, Message, Pose, Proximity
from palpate.nodes.base import Node
from palpate.records.reader import Recording
from palpate.views.shown import Finger, fingers, links_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Columns = dict[str, np.ndarray]
USUAL: tuple[type[Message], ...] = (Force, Friction, Pose, Proximity)
"""The types of messages that most pictures need, and whose messages are short."""
MARGIN, LEAST_MARGIN = 0.1, 0.1  # [1] fraction of the contacts' duration; [s]
GAP = 0.05  # [s] shorter losses of contact do not end a touch


class TouchStreams:
    """The streams of a recording for pictures; None for streams that do not exist or are empty.

    finger   streams of the finger; default: the first finger
    whole    read the whole recording, even if the contacts take a small part of it
    contact  columns of the finger's contact
    shown    begin and end [s] of the contacts with a margin, if they take less than half of the recording: the interval
             shown over time. None: the whole recording
    span     first and last time [s] of the contact's messages
    read     the interval [s] that is read, to skip long times without contact. None: the whole recording
    """

    def __init__(self, recording: Recording, finger: Finger | None = None, whole: bool = False) -> None:
        self.recording = recording
        self._tables: dict[str, Columns | None] = {}
        every = fingers(*links_of(recording))
        self._finger = every[0] if finger is None else finger
        self.contact: Columns | None = None
        self.shown: tuple[float, float] | None = None
        self.read: tuple[float, float] | None = None
        self.span = (0.0, 0.0)
        name = self.stream_of(Contact)
        columns = recording.columns(name) if name is not None else None
        if columns is not None and len(columns["tick"]):
            self.contact, time = columns, columns["time"]
            self.shown, self.span = _time_window(columns), (float(time[0]), float(time[-1]))
            whole = whole or len(every) > 1  # pictures of several fingers show the same instants
            if self.shown is not None and not whole:
                self.read = self.shown
                part = slice(*np.searchsorted(time, (self.shown[0] - 1e-9, self.shown[1] + 1e-9)))
                self.contact = {name: values[part].copy() for name, values in columns.items()}

    @cached_property
    def fingers(self) -> list[TouchStreams]:
        """The streams of each finger; this object for the first."""
        return [self, *(TouchStreams(self.recording, finger) for finger in fingers(*links_of(self.recording))[1:])]

    def stream_of(self, kind: type[Message]) -> str | None:
        """The finger's stream of a message type; None if it has none."""
        return self._finger.get(full_name(kind))

    def __getitem__(self, kind: type[Message]) -> Columns | None:
        """The columns of the finger's stream of a message type, with those of texts."""
        name = self.stream_of(kind)
        return None if name is None else self._table(name)

    def _table(self, name: str) -> Columns | None:
        """The columns of a stream. The first call also reads the others that pictures usually need, so that the file is
        read once."""
        if name not in self._tables:
            usual = (self.stream_of(kind) for kind in USUAL)
            names = {name, *filter(None, usual), *self._finger.near} - self._tables.keys()
            for stream, columns in self.recording.tables(names, self.read, texts=True).items():
                self._tables[stream] = columns if len(columns["tick"]) else None
        return self._tables[name]

    def settings(self, stream: str | None) -> dict[str, Any]:
        """Settings of the node that sent a stream; empty if unknown."""
        return self.node(stream).get("settings", {})

    def make(self, stream: str | None) -> Any:
        """A new node with the class and settings of the node that sent a stream; None if it cannot be made here."""
        node = self.node(stream)
        try:
            return recorded_class(node["class"], Node)(**node.get("settings", {}))
        except (KeyError, ImportError, AttributeError, TypeError, ValueError, OSError):
            return None

    @cached_property
    def near(self) -> list[Columns]:
        """Columns of the finger's streams of Proximity, one for each organ."""
        every = (self._table(stream) for stream in self._finger.near)
        return [columns for columns in every if columns is not None]

    @cached_property
    def motions(self) -> list[str]:
        """Of each of these streams, the stream of the motion in whose frame it is; "": of an organ at rest."""
        pairs = zip(self._finger.near, self._finger.supports, strict=True)
        return [motion for near, motion in pairs if self._table(near) is not None]

    def at(self, kind: type[Message], ticks: list[int], stream: str | None = None) -> dict[int, Any]:
        """The messages of a type at these ticks, by tick, from a stream (default: the finger's); decodes only these."""
        stream = stream or self.stream_of(kind)
        messages: dict[int, Any] = {}
        if stream is None:
            return messages
        wanted = set(ticks)
        for name, tick, _, payload in self.recording.raw({stream}):
            if tick in wanted:
                messages[tick] = self.recording.decode(name, tick, payload, kind)
                if len(messages) == len(wanted):
                    break
        return messages

    def over_time(self, axes: Axes, time: np.ndarray) -> None:
        """Set the time axis: all times [s] (n), or the part of the recording that is shown."""
        part = "" if self.shown is None else f": the contacts in {self.span[0]:.0f} to {self.span[1]:.0f} s"
        axes.set(xlabel=f"time [s]{part}", xlim=self.shown or (time[0], max(time[-1], time[0] + 1e-3)))

    def node(self, stream: str | None) -> dict[str, Any]:
        """The plan's entry for the node that sent a stream; empty if unknown."""
        if stream is None or stream not in self.recording.streams:
            return {}
        producer = self.recording.streams[stream].producer
        nodes = self.recording.about.get("plan", {}).get("nodes", [])
        return next((node for node in nodes if node.get("name") == producer), {})


def _time_window(contact: Columns) -> tuple[float, float] | None:
    """Begin and end [s] of the contacts with a margin; None if they take at least half of the recording."""
    time = contact["time"]
    if not (found := touches(time, contact["force"])):
        return None
    begin, end = time[found[0].start], time[found[-1].stop - 1]
    margin = max(MARGIN * (end - begin), LEAST_MARGIN)
    if end - begin + 2.0 * margin > 0.5 * (time[-1] - time[0]):
        return None
    return max(begin - margin, time[0]), min(end + margin, time[-1])


def together(*columns: Columns) -> list[Columns]:
    """The rows of several streams at their common ticks, each tick once."""
    ticks = columns[0]["tick"]
    for other in columns[1:]:
        ticks = np.intersect1d(ticks, other["tick"])
    ticks = np.unique(ticks)
    rows = [np.searchsorted(table["tick"], ticks) for table in columns]
    return [{name: values[row] for name, values in table.items()} for table, row in zip(columns, rows, strict=True)]


def touches(time: np.ndarray, force: np.ndarray) -> list[slice]:
    """The intervals with contact, in order: from the last sample without force to the next one without.

    time   [s] (n)
    force  [N] (n)  normal force; a loss of contact shorter than 50 ms does not end a touch
    """
    at = np.flatnonzero(force > 0.0)
    if not len(at):
        return []
    cuts = np.flatnonzero(time[at[1:]] - time[at[:-1]] > GAP)
    begins, ends = at[np.r_[0, cuts + 1]], at[np.r_[cuts, len(at) - 1]]
    return [slice(max(b - 1, 0), min(e + 2, len(time))) for b, e in zip(begins.tolist(), ends.tolist(), strict=True)]


def millijoules(energy: float) -> str:
    """An energy [J] as text in mJ, with two digits below 1 mJ; 0 below 1 nJ, the rounding error."""
    if abs(energy) < 1e-9:
        return "0 mJ"
    return f"{1e3 * energy:.1f} mJ" if abs(energy) >= 1e-3 else f"{1e3 * energy:.2g} mJ"


def work(way: np.ndarray, force: np.ndarray) -> float:
    """Work [J] of a force [N] along a path [m], by the trapezoidal rule; the enclosed area of a closed loop."""
    return float(np.sum((force[1:] + force[:-1]) / 2 * np.diff(way)))
