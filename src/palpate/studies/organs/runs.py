"""Run touches of one setting as lanes of one process, and keep what the invariants need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.run.lane_runner import LaneKeep, LaneRunner
from palpate.launch.run.lanes import Prepared, columns_of, prepare
from palpate.studies.organs.touches import Setting, Touch, segments, surface_sets

KEPT = {
    "finger": ("position", "velocity"),
    "collision": ("foot", "normal", "approach", "gap"),
    "contact": ("force", "foot", "normal", "compression", "indentation", "lateral_force"),
    "friction": ("force",),
    "controller": ("force",),
}  # fmt: skip
"""Fields of the streams that are kept, of each finger."""
ROOM = 200e6  # [bytes] of kept values of a batch
BYTES = 280  # of a tick of a finger


@dataclass(frozen=True)
class Traces:
    """What one finger of each touch of a batch went through, all (L,T) or (L,T,3) and in SI units.

    ticks   [1] (L) number of ticks of each touch; later values are 0
    failed  error of a lane that stopped, by lane
    nodes   settings of the nodes of the graph by name
    """

    setting: Setting
    values: dict[str, np.ndarray]
    ticks: np.ndarray
    failed: dict[int, str]
    nodes: dict[str, dict[str, Any]]
    step: float

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]


def launch(setting: Setting, folder: Path, duration: float, extra: Sequence[str] = ()) -> LaunchFile:
    """The run of a setting, whose hands do not matter yet."""
    return find(setting.graph).but(overrides=[*surface_sets(setting, folder), *extra], duration=duration)


def lanes_of(setting: Setting, duration: float) -> int:
    """Number of touches that a batch may have."""
    return max(4, int(ROOM / (duration * setting.rate * BYTES * setting.fingers)))


def run(touches: Sequence[Touch], folder: Path, threads: int | None = None, extra: Sequence[str] = ()) -> list[Traces]:
    """Run touches of one setting in parallel; the traces of each finger.

    GraphError, ArgumentError, NodeError: the setting is refused, by the loader or by a node.
    """
    setting, longest = touches[0].setting, max(touch.duration for touch in touches)
    described = launch(setting, folder, longest, [*touches[0].hand_sets(), *extra])
    graph = described.load()
    streams = [s for s in KEPT if s != "friction" or setting.friction]
    keep = [(stream + tag, name) for tag in setting.tags for stream in streams for name in KEPT[stream]]
    first = prepare(described, keep, graph)
    ticks = round(longest * setting.rate)
    valid = np.array([min(ticks, round(touch.duration * setting.rate)) for touch in touches])
    prepared = [_with_hands(first, touch, count) for touch, count in zip(touches, valid.tolist(), strict=True)]
    arrays, lanes = columns_of(first, keep, len(prepared), ticks), LaneRunner(LaneKeep(keep, ticks), threads)
    try:
        lanes.start(first, arrays)  # a node that does not start refuses the setting, not every touch
        failed = {lane: str(error) for lane, error in lanes.run(prepared.__getitem__, arrays).failures.items()}
    finally:
        lanes.close()
    columns = {f"{s}.{n}": column for (s, n), column in zip(keep, arrays, strict=True)}
    nodes = {node.name: dict(node.settings) for node in first.job.nodes}
    return [
        Traces(setting, {n.replace(f"{tag}.", ".", 1): columns[n] for n in columns if f"{tag}." in n}, valid, failed,
               {n.removesuffix(tag) if tag else n: s for n, s in nodes.items()}, 1.0 / setting.rate)
        for tag in setting.tags
    ]  # fmt: skip


def _with_hands(first: Prepared, touch: Touch, ticks: int) -> Prepared:
    """A lane like the first one, with the hands of this touch, which ends with it."""
    changed: dict[str, dict[str, Any]] = {}
    for tag, finger in zip(touch.setting.tags, touch.fingers, strict=True):
        origin = list(finger.origin)
        changed[f"device{tag}"] = {"origin": origin, "begin": list(finger.begin), "path": segments(finger)}
        changed[f"finger{tag}"] = changed[f"statics{tag}"] = {"origin": origin}
    nodes = tuple(
        msgspec.structs.replace(node, settings={**node.settings, **changed.get(node.name, {})})
        for node in first.job.nodes
    )
    return replace(first, job=msgspec.structs.replace(first.job, nodes=nodes), ticks=ticks)
