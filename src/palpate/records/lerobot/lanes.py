"""Lanes of an ensemble as episodes of a data set."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.engine.graph import Graph
from palpate.engine.job import NodeJob
from palpate.messages.record import layout
from palpate.physics.errors import ArgumentError
from palpate.records.lane_store import as_coordinate
from palpate.records.lerobot.features import Sources, find_sources, target_of
from palpate.records.lerobot.frames import Frames, features_of, sample_frames
from palpate.records.lerobot.writer import LeRobotSet


def lane_sources(graph: Graph) -> tuple[Sources, list[str]]:
    """The streams of a graph that become features, and those that lanes cannot keep because their number of values is
    known only at run time. ArgumentError: no finger, or no touch."""
    running = [node.name for node in graph.nodes.values() if node.off is None and not node.observer]
    found = find_sources(graph, {name: graph.nodes[name].edges for name in running}, set(running))
    kept = [window for window in found.windows if all(_is_fixed(graph, *field) for field in window.fields)]
    left = [window.key for window in found.windows if window not in kept]
    if not found.poses or not kept:
        raise ArgumentError(f"form='lerobot': {graph.path.stem} sends no {'Contact' if found.poses else 'Pose'} of a "
                            "finger that a lane can keep; expected a graph such as kidney")  # fmt: skip
    return Sources(found.poses, found.hands, tuple(kept)), left


def _is_fixed(graph: Graph, stream: str, name: str) -> bool:
    """Whether all messages of a stream have the same number of values in this field."""
    return layout(graph.streams[stream])[name].base.fields is None


class LaneEpisodes:
    """Writes blocks of lanes as episodes; lanes that failed are left out.

    out       folder of the new set
    graph, sources, frames  see `Sources` and `Frames`
    time      [s] (rows) of the kept values
    lanes     number of all lanes
    settings  varied settings by path, a value for each lane
    nodes     the nodes of a lane by its number

    ArgumentError: the folder is not empty, the ticks are fewer than the samples, or too short.
    """

    def __init__(
        self, out: Path, graph: Graph, sources: Sources, frames: Frames, time: np.ndarray, lanes: int,
        settings: Mapping[str, Any], nodes: Callable[[int], Sequence[NodeJob]], about: Mapping[str, Any],
    ) -> None:  # fmt: skip
        ticks = 1.0 / (time[1] - time[0]) if len(time) > 1 else 0.0
        if ticks * (1.0 + 1e-6) < frames.touch:
            raise ArgumentError(f"touch_rate: found {frames.touch:g} Hz, expected at most {ticks:.4g}, the kept ticks "
                                "per second")  # fmt: skip
        self._graph, self._sources, self._frames, self._time = graph, sources, frames, time
        self._settings = {path: as_coordinate(values) for path, values in settings.items()}
        self._nodes, self._hands = nodes, dict[int, dict[str, dict[str, Any]]]()
        self._known: dict[str, np.ndarray] = {}
        self._times = frames.times(time[0], time[-1])
        kinds = {field: layout(graph.streams[field[0]])[field[1]] for field in sources.fields}
        blank = {field: np.zeros((1, 1), kind) for field, kind in kinds.items()}
        features = features_of(sources, frames, blank)
        about = {**about, "touch_rate": frames.touch, "begin": self._times[0]}
        task, most = f"touch: {graph.path.stem}", lanes * len(self._times)
        self.set = LeRobotSet(out, frames.rate, features, task, about, most)

    def write(
        self, first: int, columns: Sequence[np.ndarray], errors: Mapping[int, str], notes: Mapping[int, str]
    ) -> None:
        """Write the lanes of a block, which begins with this lane."""
        lanes = np.array([lane for lane in range(first, first + len(columns[0])) if lane not in errors], int)
        if not len(lanes):
            return
        values = {field: column[lanes - first] for field, column in zip(self._sources.fields, columns, strict=True)}
        clocks = {stream: self._time for stream, _ in self._sources.fields}
        targets = [np.stack([self._target(hand, lane) for lane in lanes]) if hand else None
                   for hand in self._sources.hands]  # fmt: skip
        self._hands.clear()
        found = sample_frames(self._sources, self._frames, self._times, values, clocks, targets)
        settings: dict[str, Any] = {path: given[lanes].tolist() for path, given in self._settings.items()}
        self.set.add(found, {"lane": lanes.tolist(), **settings})

    def watch(self, lane: int, nodes: Sequence[NodeJob]) -> None:
        """Remember the hands of a lane until it is written: to prepare it again takes about 10 ms."""
        self._hands[lane] = {node.name: dict(node.settings) for node in nodes if node.name in self._sources.hands}

    def _target(self, hand: str, lane: int) -> np.ndarray:
        """The commanded positions [m] (frames, 3) of a lane."""
        if lane not in self._hands:  # it was computed in another process
            self.watch(lane, self._nodes(lane))
        settings = self._hands[lane][hand]
        key = f"{hand}, {settings}"
        if key not in self._known:
            kind: Any = self._graph.nodes[hand].cls
            self._known = {key: target_of(settings, kind, self._times)}  # equal lanes follow each other
        return self._known[key]
