"""Results that a study keeps of each run: numbers and curves of its streams, or the whole recording.

    peak contact.force          value of the largest magnitude; also `mean`, `last`
    at 0.9 s contact.force      the last value sent up to this time
    curve contact.force         all values over time
    recording                   the whole run

`controller.force[2]` is a component of a vector; without an index the length of the vector is kept.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.engine.faults import choices
from palpate.engine.graph import Graph
from palpate.messages import fields
from palpate.physics.errors import ArgumentError
from palpate.records.samples import Samples
from palpate.units.quantity import UnitError, convert
from palpate.views.run import Run

RECORDING = "recording"
Streams = Mapping[str, Mapping[str, Samples]]
"""Kept fields by stream and name, with one row per message."""
NUMBERS: dict[str, Any] = {
    "peak": lambda values: values[np.argmax(np.abs(values))],
    "mean": np.mean,
    "last": lambda values: values[-1],
}
_FORM = re.compile(r"(?P<how>\S+)(?P<time>.*)\s(?P<stream>\S+)\.(?P<field>\w+)(?:\[(?P<index>\d+)\])?", re.DOTALL)
EXAMPLE = f"'peak contact.force', {', '.join(f'{how} ...' for how in (*NUMBERS, 'at 0.9 s', 'curve'))}, or 'recording'"


@dataclass(frozen=True)
class Kept:
    """One kept result.

    text           its description in `keep`, which is also the name of its column
    how            one of `NUMBERS`, "at" or "curve"
    stream, field, index  source; index None: a number, or the length of a vector
    time           [s] for "at"
    unit           SI unit
    """

    text: str
    how: str
    stream: str
    field: str
    index: int | None
    time: float
    unit: str

    @property
    def quantity(self) -> str:
        """The source without `how`: `contact.force`."""
        return self.text.rpartition(" ")[2]

    def values(self, run: Run | Streams) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] (n) and values (n) of a run. ArgumentError: the run has no values."""
        given = run[self.stream][self.field]
        if isinstance(given, list):
            raise ArgumentError(f"keep {self.text!r}: its arrays change in length, expected a number or a vector")
        if not len(given):
            raise ArgumentError(f"keep {self.text!r}: the stream sent no message")
        values = np.asarray(given, dtype=float)
        if self.index is not None and (values.ndim < 2 or self.index >= values.shape[1]):
            raise ArgumentError(f"keep {self.text!r}: found an array of shape {values.shape[1:]}")
        if self.index is not None:
            values = values[:, self.index]
        return np.asarray(given.time), values if values.ndim == 1 else np.linalg.norm(values, axis=1)

    def number(self, run: Run | Streams) -> float:
        """The number of a run. ArgumentError: the run has no value."""
        time, values = self.values(run)
        if self.how != "at":
            return float(NUMBERS[self.how](values))
        at = int(np.searchsorted(time, self.time + 1e-9, side="right")) - 1
        if at < 0 or self.time > time[-1] + 1e-9:
            raise ArgumentError(f"keep {self.text!r}: messages from {time[0]:g} to {time[-1]:g} s")
        return float(values[at])


def kept_results(texts: Iterable[str], graph: Graph) -> tuple[Kept, ...]:
    """The kept results of the runs of a graph, without recordings. ArgumentError: an unknown stream or field, or an
    invalid text."""
    return tuple(_parse_kept(text, graph) for text in texts if text != RECORDING)


def _parse_kept(text: Any, graph: Graph) -> Kept:
    form = _FORM.fullmatch(text.strip()) if isinstance(text, str) else None
    how = form["how"] if form else ""
    if form is None or how not in (*NUMBERS, "at", "curve") or (how != "at" and form["time"].strip()):
        raise ArgumentError(f"keep: found {text!r}, expected {EXAMPLE}")
    stream, name = form["stream"], form["field"]
    if stream not in graph.streams:
        raise ArgumentError(f"keep {text!r}: no stream {stream!r}. {choices('Streams', stream, graph.streams)}")
    known = {field.name: field for field in fields(graph.streams[stream])}
    if name not in known:
        raise ArgumentError(f"keep {text!r}: {stream} has no field {name!r}. {choices('Fields', name, known)}")
    if known[name].type not in (int, float) and len(known[name].shape) != 1:
        raise ArgumentError(f"keep {text!r}: this field is no number and no vector")
    try:
        time = convert(form["time"], "s") if how == "at" else 0.0
    except UnitError as error:
        raise ArgumentError(f"keep {text!r}: {error}; expected 'at 0.9 s {stream}.{name}'") from None
    index = None if form["index"] is None else int(form["index"])
    return Kept(" ".join(text.split()), how, stream, name, index, time, known[name].unit)
