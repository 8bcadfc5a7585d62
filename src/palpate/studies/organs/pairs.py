"""Invariants of pairs of touches: organ and hand turned together, and the same touch on a finer mesh.

Positions of the device are exact in these touches, because encoder steps of a turned device differ.

turned   largest difference of the contact force over the peak <= 0.1 %
refined  rms difference of the contact force over the peak of the finer mesh <= 5 % from 600 to 5000 vertices, 1 % from
         5000 to 300 000; for smooth surfaces, whose meshes all approach one surface
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.physics.device.falcon import HOME
from palpate.physics.errors import PalpateError
from palpate.studies.organs.invariants import Score
from palpate.studies.organs.runs import run
from palpate.studies.organs.search import WITH_BASIS, Found
from palpate.studies.organs.touches import Finger, Setting, Touch, draw_touch, reachable
from palpate.studies.organs.zoo import COARSE, FINE, USUAL, Specimen

TURNED = 1e-3  # [1] of the peak
REFINED = {(COARSE, USUAL): 0.05, (USUAL, FINE): 0.01}  # [1] of the peak
LIGHT = 0.2  # [N] peak below which a touch is not compared


def turn_touch(touch: Touch, turn: Rotation) -> Touch:
    """The touch with organ and hand turned about the middle of the organ."""
    setting = touch.setting
    x, y, z = (turn * Rotation.from_rotvec(setting.rotation)).as_rotvec().tolist()
    fingers = tuple(_turn_finger(finger, turn) for finger in touch.fingers)
    return Touch(replace(setting, rotation=(x, y, z)), fingers, touch.seed)


def _turn_finger(finger: Finger, turn: Rotation) -> Finger:
    def turn_point(point: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = turn.apply(point)
        return (float(x), float(y), float(z))

    path: list[dict[str, Any]] = []
    for segment in finger.path:
        path.append(segment | {"to": list(turn_point(segment["to"]))} if "to" in segment else segment)
    points = np.array([turn_point(finger.begin), *(s["to"] for s in path if "to" in s)])
    x, y, z = 0.5 * (points.min(axis=0) + points.max(axis=0)) - HOME
    return Finger(turn_point(finger.begin), (float(x), float(y), float(z)), tuple(path))


def forces(touches: Sequence[Touch], folder: Path) -> list[np.ndarray]:
    """Contact force [N] of each touch over time, of its first finger."""
    traces = run(touches, folder)[0]
    return [column[:ticks] for column, ticks in zip(traces["contact.force"], traces.ticks, strict=True)]


def rotation_scores(setting: Setting, count: int, seed: int, folder: Path) -> list[tuple[Touch, Score]]:
    """Scores of `count` touches that are turned by one random rotation."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed)
    exact, pairs = replace(setting, exact=True), list[tuple[Touch, Touch]]()
    while len(pairs) < count:
        touch = draw_touch(exact, rng)
        other = turn_touch(touch, turn)
        if all(map(reachable, other.fingers)):
            pairs.append((touch, other))
    one, two = (forces([pair[k] for pair in pairs], folder) for k in (0, 1))
    return [(pair[1], _difference(np.abs(a - b).max(), a, TURNED)) for pair, a, b in zip(pairs, one, two, strict=True)]


def refinement_scores(
    setting: Setting, count: int, seed: int, folder: Path, meshes: tuple[int, int] = (COARSE, USUAL)
) -> list[tuple[Touch, Score]]:
    """Scores of `count` touches on a coarser and a finer mesh."""
    rng = np.random.default_rng(seed)
    coarse, fine = (replace(setting, exact=True, count=n) for n in meshes)
    touches = [draw_touch(coarse, rng) for _ in range(count)]
    finer = [replace(touch, setting=fine) for touch in touches]
    one, two = forces(touches, folder), forces(finer, folder)
    return [
        (t, _difference(float(np.sqrt(np.mean((a - b) ** 2))), b, REFINED[meshes]))
        for t, a, b in zip(touches, one, two, strict=True)
    ]


def _difference(value: float, reference: np.ndarray, bound: float) -> Score:
    peak = float(reference.max())
    if peak < LIGHT:
        return Score(0.0, 0.0, 0.0, bound)
    return Score(float(value) / peak / bound, 0.0, float(value) / peak, bound)


def compare_pairs(
    specimens: Sequence[Specimen], bodies: Sequence[str], count: int, seed: int, folder: Path, fine: bool = False
) -> Iterator[Found]:
    """The worst of `count` turned touches, and of `count` touches on a finer mesh, of each smooth surface with each
    body that does not refuse it; with `fine` also on 300 000 vertices, which takes 10 s each."""
    for one in specimens:
        if not one.smooth or one.patch == "plane":
            continue
        for body in bodies:
            setting = Setting(one.name, 0 if one.patch else USUAL, body)
            if not one.patch and body in WITH_BASIS:
                continue
            try:
                yield _worst("turned", rotation_scores(setting, count, seed, folder))
            except PalpateError:  # too thin for the layers of the body
                continue
            if not one.patch:
                for meshes in [(COARSE, USUAL), (USUAL, FINE)][: 1 + fine]:
                    yield _worst("refined", refinement_scores(setting, count, seed, folder, meshes))


def _worst(name: str, listed: list[tuple[Touch, Score]]) -> Found:
    touch, score = max(listed, key=lambda pair: pair[1].score)
    return Found(touch, name, score)
