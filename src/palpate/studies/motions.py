"""Motions of a simulated hand: its path at several speeds, and random strokes through the same region."""

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.launch.load.files import Override
from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.device.hand import SimulatedOperator

STROKES = 8  # in a random motion
SLOWEST = 0.2  # [1] Speed of the slowest stroke over that of the fastest
PEAK = 1.875  # [1] Peak speed over mean speed of a minimum-jerk move
AFTER = 0.1  # [s] of rest after the last stroke


def at_speeds(launch: LaunchFile, speeds: Sequence[float]) -> dict[float, LaunchFile]:
    """The run with the hand at each of these speeds, with its duration scaled; unchanged if no hand follows a path."""
    hands = hands_of(launch)
    if not hands:
        return {1.0: launch}
    return {
        speed: launch.but(
            overrides=[f"{name}.speed_factor={hand.speed_factor * speed}" for name, hand in hands.items()],
            duration=launch.duration and launch.duration / speed,
        )
        for speed in speeds
    }


def hands_of(launch: LaunchFile) -> dict[str, SimulatedOperator]:
    """The simulated hands that follow a path."""
    return {
        name: spec.cls(**spec.settings)
        for name, spec in launch.load().nodes.items()
        if issubclass(spec.cls, SimulatedOperator) and not spec.cls.hardware and spec.settings.get("path")
    }


def peak_speeds(launch: LaunchFile, speeds: Sequence[float]) -> tuple[float, float]:
    """Peak speed [m/s] of the slowest and of the fastest move of the hands at these speed factors."""
    found = list[float]()
    for hand in hands_of(launch).values():
        lengths = np.linalg.norm(np.diff(hand.points(), axis=0), axis=1)
        peaks = [1.0 if segment.shape == "linear" else PEAK for segment in hand.path]
        speed = lengths / np.diff(hand.ends(), prepend=0.0) * peaks
        found += speed[_moves(hand, launch.duration)].tolist()
    return min(found, default=0.0) * min(speeds), max(found, default=0.0) * max(speeds)


def others(launch: LaunchFile, reach: tuple[float, float], seeds: Iterable[int]) -> Iterator[LaunchFile]:
    """The run with random motions of its hands: straight strokes between random points of the path.

    The first and the last stroke have the fastest speed of `reach` [m/s]. In every third motion all strokes do, with
    short holds: the worst case within `reach`. Yields nothing if no hand moves.
    """
    hands = hands_of(launch) if reach[1] else {}
    free = replace(launch, overrides=tuple(each for each in launch.overrides if not _sets_path(each)))
    for seed in seeds if hands else ():
        draw, texts, longest = np.random.default_rng(seed), list[str](), 0.0
        for name, hand in hands.items():
            path = _strokes(hand, _moves(hand, launch.duration), reach[1], draw, seed % 3 == 0)
            texts += [f"{name}.path={json.dumps(path)}", f"{name}.speed_factor=1"]
            longest = max(longest, sum(step.get("time", 0.0) + step.get("hold", 0.0) for step in path))
        yield free.but(overrides=texts, duration=longest + AFTER)


def _sets_path(override: str | Override) -> bool:
    """Whether an override sets a path of the scene, which has no effect once the path of the node is set."""
    keys = override.keys if isinstance(override, Override) else override.partition("=")[0].split(".")
    return keys[0] == "scene" and keys[-1] == "path"


def _moves(hand: SimulatedOperator, duration: float | None) -> np.ndarray:
    """Indices of the path segments that move the hand and begin within the duration [s]."""
    begins = hand.ends() - np.diff(hand.ends(), prepend=0.0)
    return np.flatnonzero(np.diff(hand.points(), axis=0).any(axis=1) & (begins < (duration or math.inf)))


def _strokes(
    hand: SimulatedOperator, moves: np.ndarray, fastest: float, draw: np.random.Generator, hurried: bool
) -> list[dict[str, Any]]:
    """A random path of one hand between points on these segments of its path; a rest if the list is empty."""
    points = hand.points() + np.array(hand.origin)
    here, path = points[0], list[dict[str, Any]]()
    for number in range(STROKES if len(moves) else 0):
        k, share = draw.choice(moves), draw.uniform()
        there = points[k] + share * (points[k + 1] - points[k])
        speed = fastest * (1.0 if hurried or number in (0, STROKES - 1) else SLOWEST ** draw.uniform())
        straight = bool(draw.integers(2))
        time = float(np.linalg.norm(there - here)) / speed * (1.0 if straight else PEAK)
        if time > 1e-3:
            shape = "linear" if straight else "minimum-jerk"
            hold = float(draw.uniform(0.01, 0.02 if hurried else 0.1))
            path += [{"to": there.tolist(), "time": time, "shape": shape}, {"hold": hold}]
            here = there
    return path or [{"hold": AFTER}]
