"""Compute points as lanes: a process starts each graph structure once, and each point only changes the settings.

A lane computes the same bits as a single run (engine/lanes.py). It keeps only the fields of the study.
"""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.engine.schedule import nanoseconds
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.lane_blocks import RESULTS
from palpate.launch.run.lane_runner import LaneKeep, LaneRunner
from palpate.launch.run.lane_values import Preparation
from palpate.launch.run.lanes import Prepared, columns_of, prepare
from palpate.launch.run.notes import RunNote
from palpate.launch.run.tasks.task import Beat
from palpate.launch.run.work.compiling import compiling
from palpate.messages.fields import fields
from palpate.messages.record import layout
from palpate.nodes.logger import Mcap
from palpate.physics.errors import ArgumentError
from palpate.records.samples import Samples
from palpate.studies.sweeps.keep import Kept
from palpate.studies.sweeps.point import Computed, Point, kept_of, text_of
from palpate.studies.sweeps.recorded import warm

RUNNERS = 4  # Maximum number of them per process, each with started nodes
LANES = 64  # Maximum number of lanes of a block
HEAD = "there", "tick", "time"

_ready: list[tuple[Any, LaneRunner]] = []  # by kept fields and number of ticks; the most recently used is last


def preparation(
    launched: Callable[[Mapping[str, Any]], LaunchFile],
    keep: Sequence[Kept],
    extremes: Mapping[str, tuple[Any, ...]],
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


def compute(
    launched: Callable[[Mapping[str, Any]], LaunchFile],
    prepare: Preparation,
    keep: Sequence[Kept],
    points: Sequence[Point],
    beat: Beat,
) -> Iterator[tuple[int, Computed]]:
    """The results of points by their place, of each structure together. Points that keep a recording, that cannot run
    as a lane, or whose lane fails, are left out."""
    groups: list[tuple[Any, dict[int, Prepared]]] = []
    for place, point in enumerate(points):
        if point.recording is not None or not keep:
            continue
        try:
            one = prepare(point.values)
        except ArgumentError:
            continue
        except Exception as error:
            yield place, Computed(error=text_of(error))
            continue
        group = next((members for structure, members in groups if structure == one.structure), None)
        if group is None:
            groups.append((one.structure, group := {}))
        group[place] = one
    for _, members in groups:
        first = next(iter(members))
        launch = launched(points[first].values)
        warm(launch, members[first].graph, beat)
        if launch.duration is None:
            continue
        ticks = max(1, round(launch.duration * members[first].job.rate))
        yield from _run(members, ticks, keep, beat)


def _run(
    members: Mapping[int, Prepared], ticks: int, keep: Sequence[Kept], beat: Beat
) -> Iterator[tuple[int, Computed]]:
    """The results of lanes of one structure by their place, without those that fail."""
    names = _names(keep)
    heads = [(stream, name) for stream in dict.fromkeys(stream for stream, _ in names) for name in HEAD]
    runner, places, reached, process = _find_runner([*heads, *names], ticks), list(members), 0, os.getpid()

    def done(ran: int) -> None:
        nonlocal reached
        if ran // ticks > reached:
            reached = ran // ticks
            beat()

    row = sum(column.nbytes for column in columns_of(members[places[0]], [*heads, *names], 1, ticks))
    count = max(1, min(LANES, RESULTS // row))
    for begin in range(0, len(places), count):
        part, since, reached = places[begin : begin + count], time.monotonic(), 0
        given = [members[place] for place in part]
        columns = columns_of(given[0], [*heads, *names], len(part), ticks)
        beat()
        with compiling(lambda count: beat() if os.getpid() == process else None):  # a child also compiles
            found = runner.run(given.__getitem__, columns, done)
        for lane, place in enumerate(part):
            if lane in found.failures:
                continue
            kept = {key: column[lane] for key, column in zip([*heads, *names], columns, strict=True)}
            one, end = members[place], nanoseconds(ticks, members[place].job.rate) * 1e-9
            notes = [RunNote(text, node, end if node else 0.0) for node, text in found.notes.get(lane, ())]
            try:
                results = kept_of(keep, _streams(one, kept, names), notes)
            except Exception as error:
                results = Computed(error=text_of(error))
            yield place, replace(results, seconds=(time.monotonic() - since) / (lane + 1))


def _streams(
    one: Prepared, columns: Mapping[tuple[str, str], np.ndarray], names: Sequence[tuple[str, str]]
) -> dict[str, dict[str, Samples]]:
    """The messages of a lane, without the ticks at which none was sent."""
    streams: dict[str, dict[str, Samples]] = {}
    for stream, name in names:
        sent = columns[stream, "there"] & (columns[stream, "tick"] == np.arange(len(columns[stream, "tick"])))
        times = columns[stream, "time"][sent].astype(float) / 1e9
        unit = next(field.unit for field in fields(one.graph.streams[stream]) if field.name == name)
        streams.setdefault(stream, {})[name] = Samples(columns[stream, name][sent], f"{stream}.{name}", unit, times)
    return streams


def _names(keep: Sequence[Kept]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((one.stream, one.field) for one in keep))


def _find_runner(names: Sequence[tuple[str, str]], ticks: int) -> LaneRunner:
    """The runner of lanes that keep these fields for this number of ticks; a known one has started nodes."""
    key = names, ticks
    for place, (known, runner) in enumerate(_ready):
        if known == key:
            _ready.append(_ready.pop(place))
            return runner
    _ready.append((key, LaneRunner(LaneKeep(list(names), ticks), 1)))
    if len(_ready) > RUNNERS:
        _ready.pop(0)[1].close()
    return _ready[-1][1]
