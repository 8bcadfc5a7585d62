"""Invariants of pairs of touches: organ and hand turned together, and the same touch on a finer mesh.

Positions of the device are exact in these touches, because encoder steps of a turned device differ.

turned   largest difference of the contact force over the peak <= 0.1 %
refined  rms difference of the contact force over the peak of the finer mesh <= 5 % from 600 to 5000 vertices, 1 % from
         5000 to 300 000; for smooth surfaces, whose meshes all approach one surface. It is compared until a foot is not
         the nearest point, by more than `TRAILS`, which the node reports as outside its range (`nodes.collision`)

Past that, near the centres of curvature, no mesh is fine enough: a finger presses with F on a surface with a centre of
curvature at the distance r from it, and the arm has the stiffness k. If F/r > k, it slides off to one side, and its
distance from the balance grows by e in about 50 ms. On a torus with a tube of 14 mm this begins at 55 % of the radius,
and at 98 % a motion of the hand by 2 µm changed the force by 0.7 %, by 10 µm 7.9 % (rms over the peak, on 300 000
vertices), where other touches change by 0.007 % per µm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.nodes.collision import TRAILS
from palpate.physics.device.falcon import HOME
from palpate.physics.errors import PalpateError
from palpate.studies.organs.runs import Traces, run
from palpate.studies.organs.score import Score
from palpate.studies.organs.search import Found
from palpate.studies.organs.settings import WITH_BASIS
from palpate.studies.organs.touches import Finger, Setting, Touch, draw_touch, reachable
from palpate.studies.organs.zoo import COARSE, FINE, USUAL, Specimen

TURNED = 1e-3  # [1] of the peak
REFINED = {(COARSE, USUAL): 0.05, (USUAL, FINE): 0.01}  # [1] of the peak
LIGHT = 0.2  # [N] peak below which a touch is not compared
EXACT = 8 * USUAL  # vertices of the mesh whose nearest point is compared with the foot


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
    return _columns(run(touches, folder)[0], "contact.force")


def _columns(traces: Traces, name: str) -> list[np.ndarray]:
    return [column[:ticks] for column, ticks in zip(traces[name], traces.ticks, strict=True)]


def ticks_in_range(traces: Traces) -> list[int]:
    """Number of ticks of each touch before a foot in contact is not the nearest point of the surface."""
    setting, counts = traces.setting, []
    closest = replace(setting, count=EXACT if setting.count else 0).closest()
    names = "finger.position", "collision.foot", "collision.approach"
    for place, foot, approach in zip(*(_columns(traces, name) for name in names), strict=True):
        off = np.linalg.norm(foot - closest.find(place)[0], axis=1)
        left = np.flatnonzero((off > TRAILS) & (approach > 0.0))
        counts.append(int(left[0]) if len(left) else len(off))
    return counts


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
    setting: Setting,
    count: int,
    seed: int,
    folder: Path,
    meshes: tuple[int, int] = (COARSE, USUAL),
    whole: bool = False,
) -> list[tuple[Touch, Score]]:
    """Scores of `count` touches on a coarser and a finer mesh.

    whole  compare also what follows after a foot is not the nearest point
    """
    rng = np.random.default_rng(seed)
    coarse, fine = (replace(setting, exact=True, count=n) for n in meshes)
    touches = [draw_touch(coarse, rng) for _ in range(count)]
    finer = [replace(touch, setting=fine) for touch in touches]
    scores = []
    one, two = run(touches, folder)[0], run(finer, folder)[0]
    until = zip(ticks_in_range(one), ticks_in_range(two), strict=True)
    for touch, a, b, ends in zip(touches, *(_columns(t, "contact.force") for t in (one, two)), until, strict=True):
        square = (a - b)[: len(a) if whole else min(ends)] ** 2
        scores.append((touch, _difference(float(np.sqrt(square.sum() / len(a))), b, REFINED[meshes])))
    return scores


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
