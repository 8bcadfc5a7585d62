"""Recordings whose motion drives a graph again: its launch file, and the recorded fields that it should explain."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from palpate.engine.faults import choices
from palpate.engine.graph import Graph
from palpate.launch.load.arguments import describe_run
from palpate.launch.load.launchfile import LaunchFile
from palpate.messages import DeviceState, Pose
from palpate.nodes.base import inputs
from palpate.physics.errors import ArgumentError
from palpate.physics.scratch import ScratchFolder
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

ROWS = 2000  # rows of a field and a recording that a fit takes; of longer ones every n-th
SOURCE = "device.RecordedPose"


@dataclass
class Measured:
    """One recording.

    launch   the run whose fingers follow the recorded motion, without the nodes that the fields do not need
    fields   "stream.field" of each measured field
    values   (rows, k) of each, at the ticks `rows`
    ticks    number of ticks of the run
    motion   (ticks, 3) [m] positions of each finger by its node
    base     the run without the recorded motion
    graph    content of the recorded graph with its scene; None: the run names another one
    folder   of temporary files, as long as this exists
    loose    settings of its motion that a fit also searches
    """

    name: str
    launch: LaunchFile
    fields: list[str]
    values: list[np.ndarray]
    rows: np.ndarray
    ticks: int
    rate: float
    motion: dict[str, np.ndarray]
    base: LaunchFile
    graph: dict[str, Any] | None
    folder: ScratchFolder = field(repr=False)
    loose: tuple[str, ...] = ()

    @property
    def time(self) -> np.ndarray:
        """[s] (rows)"""
        return self.rows / self.rate


def read_recording(
    path: Path, fields: Sequence[str], graph: str | None, scene: str | None, sets: Sequence[str], until: float | None
) -> Measured:
    """A recording with these fields.

    graph, scene, sets  another graph or scene than the recorded one, and values set in it
    until  [s] leave out the rest

    RecordingError: it lacks a stream or field, or messages. GraphError: the graph does not fit.
    """
    recording, folder = Recording(path), ScratchFolder("fit-run")
    content = None if graph else _recorded_graph(recording)
    base = _recorded_launch(content, recording, folder, scene, sets) if content else \
        describe_run(str(graph), scene=scene, duration=None, sets=sets, nodes={})  # fmt: skip
    loaded = base.load()
    recorded = recording.about.get("plan", {}).get("rate", loaded.rate)
    if recorded != loaded.rate:
        raise RecordingError(f"{path}: recorded at {recorded:g} Hz, but the graph has {loaded.rate:g} Hz; expected the "
                             f"same: --set rate={recorded:g}")  # fmt: skip
    moved = fingers(loaded)
    for name in moved:
        if name not in recording.streams:
            raise RecordingError(
                f"{path}: the graph moves {name!r}, but the recording has no stream of this name; it is of another "
                f"graph. {choices('Recorded', name, recording.streams)}"
            )
    file, present = recording.file(), recording.ticks()
    ticks = min(len(present[name]) for name in moved)
    if until is not None:
        ticks = min(ticks, max(1, round(until * loaded.rate)))
    for name in moved:
        _check_gaps(path, name, present[name][:ticks], loaded.rate)
    values, rows = _recorded_fields(recording, fields, ticks)
    places = {name: np.asarray(recording.columns(name)["position"])[:ticks] for name in moved}
    launch = driven(base, {name: (file, name) for name in moved}, fields).but(duration=ticks / loaded.rate)
    return Measured(path.name, launch, list(fields), values, rows, ticks, loaded.rate, places, base, content, folder)


def driven(launch: LaunchFile, motions: Mapping[str, tuple[Path, str]], fields: Sequence[str]) -> LaunchFile:
    """The run whose fingers follow motions, without the nodes that the fields do not need.

    motions  by finger: a file, and the stream if it is a recording
    """
    before, sources = launch.load(), []
    for name, (file, stream) in motions.items():
        sources += [f"{name}.use={SOURCE}", f"{name}.path={json.dumps(str(file))}", f"{name}.stream={stream}"]
        sources += [f"{name}.in.{edge.port}=null" for edge in before.nodes[name].edges]
    changed = launch.but(overrides=sources)
    graph = changed.load()
    streams = {stream: name for name, spec in graph.nodes.items() for stream in spec.streams}
    for each in fields:
        if (stream := each.rpartition(".")[0]) not in streams:
            raise ArgumentError(f"--to {each}: no stream {stream!r}. {choices('Streams', stream, streams)}")
    needed = list(dict.fromkeys(streams[each.rpartition(".")[0]] for each in fields))
    for name in needed:  # grows by the senders
        needed += [edge.producer for edge in graph.nodes[name].edges if edge.producer not in needed]
    return changed.but(overrides=[f"{name}=null" for name in graph.nodes if name not in needed])


def _recorded_graph(recording: Recording) -> dict[str, Any]:
    """The recorded graph with its scene. RecordingError: the file does not contain it."""
    plan = recording.about.get("plan", {})
    if not plan.get("source"):
        raise RecordingError(f"{recording.path}: it does not contain its graph; give one with --graph GRAPH")
    return {**plan["source"], "scene": plan["scene"]}


def _recorded_launch(
    content: dict[str, Any], recording: Recording, folder: ScratchFolder, scene: str | None, sets: Sequence[str]
) -> LaunchFile:
    """The run of a recorded graph."""
    file = Path(folder.name) / f"{Path(recording.about['plan']['path']).stem}.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    return describe_run(file, scene=scene, duration=None, sets=sets, nodes={})


def fingers(graph: Graph) -> list[str]:
    """The nodes that compute a pose from a device. ArgumentError: the graph has none."""
    poses = (name for name, spec in graph.nodes.items() if tuple(spec.streams.values()) == (Pose,) and not spec.off)
    found = [name for name in poses if any(port.type is DeviceState for port in inputs(graph.nodes[name].cls))]
    if not found:
        raise ArgumentError(f"{graph.path.stem}: found no finger that a device moves; expected a graph such as kidney")
    return found


def _check_gaps(path: Path, stream: str, ticks: np.ndarray, rate: float) -> None:
    """RecordingError: messages of a stream are missing."""
    missing = np.flatnonzero(ticks != np.arange(len(ticks)))
    if len(missing):
        at = int(missing[0])
        cure = f"--until '{at / rate:.4g} s' takes what precedes it, or " if at > 100 else ""
        raise RecordingError(
            f"{path}: stream {stream!r} has a gap: tick {at} is missing, and {int(ticks[at])} follows, so the motion "
            f"is unknown. {cure}record on simulated time, or with every tick"
        )


def _recorded_fields(recording: Recording, fields: Sequence[str], ticks: int) -> tuple[list[np.ndarray], np.ndarray]:
    """The values (rows, k) of each field, and the ticks of the rows. RecordingError: one is not recorded."""
    found: list[np.ndarray] = []
    every = -(-ticks // ROWS)
    rows = np.arange(0, ticks, every)
    for path in fields:
        stream, _, name = path.rpartition(".")
        if stream not in recording.streams:
            raise RecordingError(f"{recording.path}: there is no stream {stream!r}. "
                                 f"{choices('Recorded', stream, recording.streams)}")  # fmt: skip
        columns = recording.columns(stream)
        if name not in columns:
            raise RecordingError(
                f"{recording.path}: {stream} has no field {name!r}. {choices('Fields', name, columns)}"
            )
        at, values = columns["tick"].astype(int), np.asarray(columns[name], float)
        place = np.minimum(np.searchsorted(at, rows), len(at) - 1)
        if len(lost := rows[at[place] != rows]):
            raise RecordingError(f"{recording.path}: stream {stream!r} has a gap: no message at tick {lost[0]}; "
                                 "expected one at every tick of the motion")  # fmt: skip
        found.append(values[place].reshape(len(rows), -1))
    return found, rows
