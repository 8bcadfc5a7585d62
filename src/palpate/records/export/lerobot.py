"""A recording as a data set of LeRobot with one episode."""

import warnings
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from palpate.engine.plan import Plan
from palpate.messages.tactile import TaxelForces
from palpate.physics.errors import PalpateWarning
from palpate.records.lerobot.features import TOUCHED, Sources, find_sources, target_of
from palpate.records.lerobot.frames import Frames, features_of, held_rows, sample_frames
from palpate.records.lerobot.pictures import FEATURE, KEY, draw_pictures
from palpate.records.lerobot.writer import LeRobotSet, check_empty
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


def write_lerobot(
    recording: Recording,
    folder: Path,
    streams: tuple[str, ...],
    every: int | None,
    fps: int = 30,
    touch_rate: float = 150.0,
    camera: bool = False,
) -> list[Path]:
    """Write a data set with one episode: docs/lerobot.md has its features.

    streams     of touch that become features; poses of fingers always do
    fps         rate of the frames [Hz]
    touch_rate  rate of the touch samples [Hz]
    camera      whether frames have a picture from the side

    RecordingError: a stream is missing or sent less often. ArgumentError: the folder is not empty, a rate is invalid.
    """
    frames = Frames(fps, float(touch_rate))
    check_empty(folder)
    plan = plan_of(recording)
    sources = _sources(recording, plan, streams)
    values, clocks = _read(recording, sources)
    for stream, clock in clocks.items():
        _check_rate(recording, stream, clock, fps if stream in sources.poses else frames.touch)
    times = frames.times(max(clock[0] for clock in clocks.values()), min(clock[-1] for clock in clocks.values()))
    targets = [_target(plan, hand, times) for hand in sources.hands]
    found = sample_frames(sources, frames, times, values, clocks, targets)
    about = {"recording": recording.path.name, "about": recording.about, "touch_rate": frames.touch, "begin": times[0]}
    features = features_of(sources, frames, values)
    if not camera:
        return LeRobotSet(folder, fps, features, f"touch: {plan.graph.path.stem}", about, len(times)).add(found)
    fingers = [values[pose, "position"][0][held_rows(clocks[pose], times)] for pose in sources.poses]
    touches = [found[window.key][0, :, -1] for window in sources.windows if window.names == TOUCHED]
    drawn = draw_pictures(recording, plan, times, fingers, touches)
    made = LeRobotSet(folder, fps, {**features, KEY: FEATURE}, f"touch: {plan.graph.path.stem}", about, len(times))
    return made.add(found, pictures={KEY: drawn})


def _sources(recording: Recording, plan: Plan, streams: Collection[str]) -> Sources:
    """The streams that become features. RecordingError: a needed one was not recorded."""
    graph, path = plan.graph, recording.path
    found = find_sources(graph, plan.edges, set(plan.order))
    kept = tuple(w for w in found.windows if {stream for stream, _ in w.fields} & set(streams))
    chosen = Sources(found.poses, found.hands, kept)
    cure = "record it (`leave_out`, `thin` of the logger), or replay the whole graph with --record"
    for stream in dict.fromkeys(stream for stream, _ in chosen.fields):
        if stream not in recording.streams:
            raise RecordingError(f"{path}: --to lerobot needs stream {stream!r}, which was not recorded; {cure}")
    if not chosen.poses or not chosen.windows:
        what = "touch (a Contact, Wrench or TaxelForces)" if chosen.poses else "the pose of a finger"
        raise RecordingError(f"{path}: --to lerobot needs a stream of {what}, found "
                             f"{', '.join(recording.streams) or 'none'}; {cure}")  # fmt: skip
    return chosen


def _read(recording: Recording, sources: Sources) -> tuple[dict[tuple[str, str], np.ndarray], dict[str, np.ndarray]]:
    """The fields (1, rows, ...) of one episode, and the times [s] (rows) of each stream."""
    names = list(dict.fromkeys(stream for stream, _ in sources.fields))
    tables = recording.tables(names)
    values: dict[tuple[str, str], np.ndarray] = {}
    for stream, name in sources.fields:
        if not len(tables[stream]["time"]):
            raise RecordingError(f"{recording.path}: stream {stream!r} has no messages; record a longer run")
        if recording.find_stream(stream).type is TaxelForces:
            rows: Any = [getattr(message, name) for message in recording.messages(stream)]
            if len({len(row) for row in rows}) > 1:
                raise RecordingError(
                    f"{recording.path}: the number of taxels of {stream!r} changes, expected one number"
                )
            tables[stream][name] = np.array(rows)
        values[stream, name] = tables[stream][name][None]
    return values, {stream: tables[stream]["time"] for stream in names}


def _check_rate(recording: Recording, stream: str, time: np.ndarray, wanted: float) -> None:
    """RecordingError: the messages are less frequent than the samples. Warn about a gap, in which samples repeat."""
    steps = np.diff(time)
    usual = float(np.median(steps)) if len(steps) else np.inf
    if usual * wanted > 1.0 + 1e-6:
        raise RecordingError(
            f"{recording.path}: stream {stream!r} has {1.0 / usual:.4g} messages per second, expected at least "
            f"{wanted:g}; lower --touch-rate or --fps, or record it without thin"
        )
    longest = int(np.argmax(steps))
    if steps[longest] > 2.0 * max(usual, 1.0 / wanted):
        warnings.warn(
            f"{recording.path}: stream {stream!r} has no message for {steps[longest]:.3g} s after "
            f"{time[longest]:.3f} s; samples there repeat the last one", PalpateWarning, stacklevel=2,
        )  # fmt: skip


def _target(plan: Plan, hand: str, times: np.ndarray) -> np.ndarray | None:
    """The commanded positions (1, frames, 3) of a scripted hand; None without one."""
    if not hand:
        return None
    spec: Any = plan.graph.nodes[hand]
    return target_of(spec.settings, spec.cls, times)[None]
