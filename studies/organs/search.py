"""A random search for touches that break an invariant, and a local search that makes the worst ones worse."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.errors import PalpateError
from palpate.studies.organs.invariants import Score, scores
from palpate.studies.organs.reference import at_rest
from palpate.studies.organs.runs import lanes_of, run
from palpate.studies.organs.touches import ORIENTATIONS, Finger, Setting, Touch, drawn, reachable
from palpate.studies.organs.zoo import COARSE, USUAL, Specimen

BODIES = ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")
WITH_BASIS = ("ReducedFE",)
"""Bodies that need a basis of the surface; only the bases that ship are used."""
RATES = {250.0: 0.1, 500.0: 0.1, 1000.0: 0.45, 2000.0: 0.15, 5000.0: 0.12, 10000.0: 0.08}  # [Hz] and their shares
FRICTION = {"LuGre": 0.5, "ElastoPlastic": 0.15, "Coulomb": 0.15, "": 0.2}
TWO = 0.1  # share of batches with two fingers
ROUGH = 0.3  # share of batches on a coarse mesh
BATCH = 60  # touches
BATCHES = 20  # Number of batches, over the least, after which a search ends although settings were refused
KEPT = 10  # worst touches of each invariant, surface and body
SHIFT, HURRY = 1.5e-3, 0.3  # [m] [1] by which the local search changes a touch


@dataclass(frozen=True)
class Found:
    """The score of an invariant in a touch."""

    touch: Touch
    invariant: str
    score: Score


@dataclass
class Results:
    """What a search found.

    touches  number of touches by surface and body
    broken   number of touches that break an invariant, by surface, body and invariant
    worst    the worst touches, by surface, body and invariant
    refused  why a setting was refused, by surface and body
    failed   errors of lanes that stopped
    """

    touches: Counter[tuple[str, str]] = field(default_factory=Counter)
    broken: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    worst: dict[tuple[str, str, str], list[Found]] = field(default_factory=dict)
    refused: dict[tuple[str, str], str] = field(default_factory=dict)
    failed: list[tuple[Touch, str]] = field(default_factory=list)

    def add(self, touch: Touch, invariant: str, score: Score, counted: bool = True) -> None:
        key = touch.setting.surface, touch.setting.body, invariant
        self.broken[key] += int(score.broken and counted)
        listed = self.worst.setdefault(key, [])
        listed.append(Found(touch, invariant, score))
        listed.sort(key=lambda found: -found.score.score)
        del listed[KEPT:]

    @property
    def total(self) -> int:
        return sum(self.touches.values())

    def top(self, count: int) -> list[Found]:
        """The worst touches, one of each surface, body and invariant; the largest score first."""
        firsts = [listed[0] for listed in self.worst.values() if listed]
        return sorted(firsts, key=lambda found: -found.score.score)[:count]


def settings(
    surfaces: Sequence[Specimen], bodies: Sequence[str], rng: np.random.Generator, rate: float | None = None
) -> Iterator[Setting]:
    """Settings of batches without end: each surface with each body in turn, the rest at random."""
    pairs = [(s, b) for s in surfaces for b in bodies if s.patch or b not in WITH_BASIS]
    while pairs:
        for index in rng.permutation(len(pairs)):
            specimen, body = pairs[index]
            rough, two, turn = rng.uniform() < ROUGH, rng.uniform() < TWO, rng.integers(len(ORIENTATIONS))
            yield Setting(
                specimen.name, 0 if specimen.patch else COARSE if rough else USUAL, body,
                str(rng.choice(list(FRICTION), p=list(FRICTION.values()))),
                rate or float(rng.choice(list(RATES), p=list(RATES.values()))), 1 + int(two),
                ORIENTATIONS[turn] if specimen.name == "kidney" else (0.0, 0.0, 0.0),
            )  # fmt: skip


def judged(
    touches: Sequence[Touch], folder: Path, results: Results, threads: int | None = None
) -> list[dict[str, Score]]:
    """Run touches of one setting, and add their scores; those of each touch, the worst of its fingers."""
    each: list[dict[str, Score]] = [{} for _ in touches]
    for traces in run(touches, folder, threads):
        for mine, found in zip(each, scores(traces, at_rest(traces)), strict=True):
            for name, score in found.items():
                if name not in mine or score.score > mine[name].score:
                    mine[name] = score
        for lane, error in traces.failed.items():
            results.failed.append((touches[lane], error))
    return each


def search(
    surfaces: Sequence[Specimen],
    bodies: Sequence[str],
    count: int,
    seed: int,
    folder: Path,
    done: Callable[[float, Results], None] = lambda share, results: None,
    *,
    batch: int = BATCH,
    rate: float | None = None,
) -> Results:
    """Touch surfaces at random.

    count   touches in all
    folder  of the meshes
    done    called after each batch with the share of the work

    PalpateError is not raised for a setting that is refused: it is listed.
    """
    results, rng = Results(), np.random.default_rng(seed)
    for number, setting in enumerate(settings(surfaces, bodies, rng, rate)):
        if results.total >= count or number > BATCHES * (1 + count // batch):
            break
        own = np.random.default_rng((seed, number))
        size = min(batch, lanes_of(setting, 2.5), count - results.total)
        touches = [replace(drawn(setting, own), seed=(seed, number, k)) for k in range(size)]
        key = setting.surface, setting.body
        try:
            for touch, found in zip(touches, judged(touches, folder, results), strict=True):
                results.touches[key] += 1
                for name, score in found.items():
                    results.add(touch, name, score)
        except PalpateError as error:
            results.refused[key] = str(error)
        done(min(1.0, results.total / count), results)
    return results


def worsened(
    start: Found,
    rounds: int,
    seed: int,
    folder: Path,
    *,
    batch: int = 24,
) -> Found:
    """A touch near this one with the largest score of its invariant: an evolution strategy, (1 + batch).

    Each round moves path and speed of the best touch so far at random, in steps that shrink unless they help.
    """
    best, rng, size, unused = start, np.random.default_rng(seed), 1.0, Results()
    for _ in range(rounds):
        near = [touch for _ in range(4 * batch) if _reached(touch := varied(best.touch, size, rng))][:batch]
        if not near:
            break
        try:
            found = judged(near, folder, unused)
        except PalpateError:
            break
        ranked = [
            (each[best.invariant], touch) for each, touch in zip(found, near, strict=True) if best.invariant in each
        ]
        score, touch = max(ranked, key=lambda pair: pair[0].score, default=(best.score, best.touch))
        size *= 1.2 if score.score > best.score.score else 0.7
        if score.score > best.score.score:
            best = Found(touch, best.invariant, score)
    return best


def _reached(touch: Touch) -> bool:
    closest = touch.setting.closest()
    return all(reachable(f) and float(closest.find(np.array(f.begin))[3]) > 4.5e-3 for f in touch.fingers)


def varied(touch: Touch, size: float, rng: np.random.Generator) -> Touch:
    """The touch with its path moved as a whole, its points moved singly, and its times scaled."""
    fingers = []
    for finger in touch.fingers:
        shift = rng.normal(size=3) * SHIFT * size
        path: list[dict[str, Any]] = []
        for segment in finger.path:
            changed = dict(segment)
            faster = float(np.exp(rng.normal() * HURRY * size))
            if "to" in segment:
                point = np.array(segment["to"]) + shift + 0.5 * rng.normal(size=3) * SHIFT * size
                changed["to"] = [round(float(x), 6) for x in point]
                changed["time"] = round(float(np.clip(segment["time"] * faster, 1e-2, 1.0)), 4)
            else:
                changed["hold"] = round(float(np.clip(segment["hold"] * faster, 0.05, 0.5)), 3)
            path.append(changed)
        x, y, z = (round(float(c), 6) for c in np.array(finger.begin) + shift)
        fingers.append(Finger((x, y, z), finger.origin, tuple(path)))
    return replace(touch, fingers=tuple(fingers))
