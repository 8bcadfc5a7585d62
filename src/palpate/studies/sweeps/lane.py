"""Compute a point as a lane: a process starts each graph structure once, and each point only changes the settings.

A lane computes the same bits as a single run (engine/lanes.py). It keeps only the fields of the study.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from palpate.engine.schedule import nanoseconds
from palpate.engine.slot import NodeError
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.lanes import LaneRun, Preparation, Prepared, prepare
from palpate.launch.run.notes import RunNote
from palpate.launch.run.work.compiling import compiling
from palpate.messages.fields import fields
from palpate.messages.record import layout
from palpate.nodes.logger import Mcap
from palpate.physics.errors import ArgumentError
from palpate.records.samples import Samples
from palpate.studies.sweeps.keep import Kept, Streams

STRUCTURES = 8  # Maximum number of started structures per process
HEAD = "there", "tick", "time"

_ready: list[tuple[Any, LaneRun]] = []  # by structure and kept fields; the most recently used is last


def preparation(
    launched: Callable[[Mapping[str, Any]], LaunchFile],
    keep: Sequence[Kept],
    extremes: Mapping[str, tuple[float, ...]],
) -> Preparation:
    """Prepares points for a lane. Its calls raise GraphError if the graph of a point is invalid, and ArgumentError if
    it cannot run as a lane, because a node or an observer is in Python or a kept field has a variable length.

    launched  the run with values by path
    """

    def load(values: Mapping[str, Any]) -> Prepared:
        launch = launched(values)
        graph = launch.load()
        if any(spec.observer and not issubclass(spec.cls, Mcap) and spec.off is None for spec in graph.nodes.values()):
            raise ArgumentError("a graph with observers")
        try:
            variable = any(layout(graph.streams[one.stream])[one.field].base.fields for one in keep)
        except (KeyError, TypeError):  # a stream that does not run, or a message that only nodes in Python hold
            variable = True
        if variable:
            raise ArgumentError("a field of variable length")
        return prepare(launch, _names(keep), graph)

    return Preparation(load, extremes)


def run(
    one: Prepared, ticks: int, keep: Sequence[Kept], begins: Callable[[], None]
) -> tuple[Streams, list[RunNote]] | None:
    """Run a lane and return its streams and notes; None if it fails. `begins` is called when the lane is ready, and
    while kernels are compiled."""
    names = _names(keep)
    heads = [(stream, name) for stream in dict.fromkeys(stream for stream, _ in names) for name in HEAD]
    try:
        lane = _lane(one, [*heads, *names], ticks, begins)
    except NodeError:
        return None
    begins()
    lane.restart([one])
    lane.run(ticks, threads=1)
    if lane.failures:
        return None
    columns = {key: column[0] for key, column in zip([*heads, *names], lane.lanes.columns, strict=True)}
    streams: dict[str, dict[str, Samples]] = {}
    for stream, name in names:
        sent = columns[stream, "there"] & (columns[stream, "tick"] == np.arange(ticks))
        time = columns[stream, "time"][sent].astype(float) / 1e9
        unit = next(field.unit for field in fields(one.graph.streams[stream]) if field.name == name)
        streams.setdefault(stream, {})[name] = Samples(columns[stream, name][sent], f"{stream}.{name}", unit, time)
    end = nanoseconds(ticks, one.job.rate) * 1e-9
    notes = [note if isinstance(note, RunNote) else RunNote(note) for note in one.graph.notes]
    return streams, notes + [RunNote(text, node, end) for node, text in lane.lanes.notes(0)]


def _names(keep: Sequence[Kept]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((one.stream, one.field) for one in keep))


def _lane(one: Prepared, names: Sequence[tuple[str, str]], ticks: int, begins: Callable[[], None]) -> LaneRun:
    """A lane for this structure: a started one, or a new one."""
    key = one.structure, names, ticks
    for place, (known, lane) in enumerate(_ready):
        if known == key:
            _ready.append(_ready.pop(place))
            return lane
    process = os.getpid()  # a forked child also compiles, but must not call `begins`
    with compiling(lambda count: begins() if os.getpid() == process else None):
        lane = LaneRun([one], names, ticks)
    _ready.append((key, lane))
    if len(_ready) > STRUCTURES:
        _ready.pop(0)[1].close()
    return lane
