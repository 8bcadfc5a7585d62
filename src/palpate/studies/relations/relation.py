"""A relation: what one change of a scene must do to the result, and how exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from palpate.studies.organs.score import Score
from palpate.studies.organs.touches import Touch
from palpate.studies.relations.runs import Run, Trace

LIGHT = 0.05
"""[N] Peak of the contact force below which shares of it are shares of this."""

STRONG = 7.0  # [N] above it the motors of the device reach their limit, in some directions
NEAR = 3e-6  # [m]


@dataclass(frozen=True)
class Case:
    """A random scene: a touch with its settings, and the folder of meshes.

    batch  seed of what the scenes of a batch share, such as the place to which an organ is moved: a body takes up to a
           second to start at a new place
    """

    touch: Touch
    folder: Path
    batch: int = 0

    @property
    def shared(self) -> np.random.Generator:
        """Random numbers that are the same for all scenes of the batch."""
        return np.random.default_rng(self.batch)

    @cached_property
    def run(self) -> Run:
        return self.run_of(self.touch)

    def run_of(self, touch: Touch) -> Run:
        """The run of another touch, with the meshes of this case."""
        sets = dict(text.split("=", 1) for text in touch.sets(self.folder))
        sets.pop("rate", None)
        parsed = {path: yaml.safe_load(value) for path, value in sets.items()}
        return Run(touch.setting.graph, parsed, touch.setting.rate, touch.setting.tags[0])

    @cached_property
    def near(self) -> Run:
        """The same motion `NEAR` away, in a direction of the batch."""
        by = self.shared.normal(size=3)
        return move_hand(self.run, NEAR * by / np.linalg.norm(by))

    def but(self, touch: Touch | None = None, **setting: Any) -> Case:
        """The case with another touch, or with other values of its setting."""
        touch = touch or self.touch
        return replace(self, touch=replace(touch, setting=replace(touch.setting, **setting)))


def move_hand(run: Run, by: np.ndarray) -> Run:
    """The run with the whole path of the hand moved [m] (3)."""
    path = [s | {"to": (np.array(s["to"]) + by).tolist()} if "to" in s else s for s in run.sets["scene.hand.path"]]
    begin = (np.array(run.sets["scene.hand.begin"], dtype=float) + by).tolist()
    return run.but({"scene.hand.begin": begin, "scene.hand.path": path})


Judge = Callable[..., Score]


@dataclass(frozen=True)
class Claim:
    """What a relation says about one case.

    runs   the runs to compare; a relation often keeps that of the case and changes it once
    judge  the score of their traces, in the same order
    """

    runs: tuple[Run, ...]
    judge: Judge


@dataclass(frozen=True)
class Relation:
    """A relation by name.

    about  one sentence: what is changed, and what must follow
    exact  how exactly: "bytes", or the bound in words
    claim  what it says about a case, with random choices; None: it says nothing about this one
    share  of the cases to which it is applied, if its runs take long
    """

    name: str
    about: str
    exact: str
    claim: Callable[[Case, np.random.Generator], Claim | None]
    share: float = 1.0


def same_bytes(one: Trace, two: Trace, *names: str) -> Score:
    """Broken where a value differs in any bit; the value is the largest difference. `names`: all fields, if none."""
    worst, first = 0.0, len(one.force)
    for name in names or one.values:
        a, b = one[name], two[name]
        unlike = np.flatnonzero((a.view(np.int64) != b.view(np.int64)).reshape(len(a), -1).any(axis=1))
        if len(unlike):
            first = min(first, int(unlike[0]))
            worst = max(worst, float(np.abs(a - b)[unlike].max()), 5e-324)
    return Score(0.0 if worst == 0.0 else np.inf, min(first, len(one.force) - 1) * one.step, worst, 0.0)


def same_force(one: Trace, two: Trace, near: Trace, share: float, factor: float = 1.0) -> Score:
    """The largest difference of the contact forces over its bound: a share of the peak, and what a motion of the hand
    by `NEAR` has changed so far (`near`), since rounding grows as that does where a finger slides off or starts to
    slip. factor [1]: of the forces of `two` over those of `one`. The comparison ends where a force exceeds `STRONG`."""
    strong = np.flatnonzero(np.any([trace.force > STRONG for trace in (one, two, near)], axis=0))
    end = int(strong[0]) if len(strong) else len(one.force)
    a, b, c = (trace.force[:end] for trace in (one, two, near))
    if not end:
        return Score(0.0, 0.0, 0.0, 0.0)
    bound = share * max(float(a.max()), LIGHT) + np.maximum.accumulate(np.abs(a - c))
    off = np.abs(a - b / factor)
    worst = int((off / bound).argmax())
    return Score(float(off[worst] / bound[worst]), worst * one.step, float(off[worst]), float(bound[worst]))


def at_least(value: float, least: float, bound: float, time: float) -> Score:
    """A value that must not fall below `least` by more than `bound`."""
    return Score(max(0.0, (least - value) / bound), time, value, least, least - bound)
