"""A random search for touches that break an invariant, and a local search that makes the worst ones worse."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.errors import PalpateError
from palpate.studies.organs.invariants import score_touch
from palpate.studies.organs.notes import collect_notes, reasons
from palpate.studies.organs.runs import lanes_of, run
from palpate.studies.organs.score import Score
from palpate.studies.organs.settings import ROUGH, draw_settings, paired
from palpate.studies.organs.touches import Finger, Touch, draw_touch, reachable
from palpate.studies.organs.trace import Trace, trace_batch
from palpate.studies.organs.zoo import Specimen

BATCH = 60  # touches
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
    bad      number of touches that break any invariant, by surface and body
    broken   number of touches that break an invariant, by surface, body and invariant
    worst    the worst touches, by surface, body and invariant
    refused  why a setting was refused, by surface and body
    failed   errors of lanes that stopped
    pairs    the worst pair of each surface that was turned, and that was refined
    related  number of touches by relation of a finger with a width (`widths`)
    apart    number of these touches that break it
    unlike   the worst of them, by relation
    unmade   why relations were refused
    noted    by surface, body and reason: a touch out of the range of the models, and the notes of its run
    """

    touches: Counter[tuple[str, str]] = field(default_factory=Counter)
    bad: Counter[tuple[str, str]] = field(default_factory=Counter)
    broken: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    worst: dict[tuple[str, str, str], list[Found]] = field(default_factory=dict)
    refused: dict[tuple[str, str], str] = field(default_factory=dict)
    failed: list[tuple[Touch, str]] = field(default_factory=list)
    noted: dict[tuple[str, str, str], tuple[Touch, list[str]]] = field(default_factory=dict)
    pairs: list[Found] = field(default_factory=list)
    related: Counter[str] = field(default_factory=Counter)
    apart: Counter[str] = field(default_factory=Counter)
    unlike: dict[str, list[Found]] = field(default_factory=dict)
    unmade: list[str] = field(default_factory=list)

    @property
    def silent(self) -> dict[tuple[str, str, str], Touch]:
        """A touch without a note by surface, body and the reason why it is out of range."""
        return {key: touch for key, (touch, texts) in self.noted.items() if not texts}

    def add(self, touch: Touch, invariant: str, score: Score, counted: bool = True) -> None:
        key = touch.setting.surface, touch.setting.body, invariant
        self.broken[key] += int(score.broken and counted)
        _keep_worst(self.worst.setdefault(key, []), Found(touch, invariant, score))

    def relate(self, listed: Sequence[Found], why: str = "") -> None:
        """Count what relations of a finger with a width found, and keep the worst; or why one was refused."""
        self.unmade += [why] if why else []
        for found in listed:
            self.related[found.invariant] += 1
            self.apart[found.invariant] += found.score.broken
            _keep_worst(self.unlike.setdefault(found.invariant, []), found)

    @property
    def total(self) -> int:
        return sum(self.touches.values())

    def top(self, count: int) -> list[Found]:
        """The worst touches, one of each surface, body and invariant; the largest score first."""
        firsts = [listed[0] for listed in self.worst.values() if listed]
        return sorted(firsts, key=lambda found: -found.score.score)[:count]


def _keep_worst(listed: list[Found], found: Found) -> None:
    """Add one; only the `KEPT` worst remain, the worst first."""
    listed.append(found)
    listed.sort(key=lambda one: -one.score.score)
    del listed[KEPT:]


def run_touches(
    touches: Sequence[Touch], folder: Path, results: Results, threads: int | None = None, notes: bool = False
) -> list[dict[str, Score]]:
    """Run touches of one setting; their scores, the worst of the fingers of each.

    notes  whether to look for notes of the first touch of this surface and body that is out of range for a reason
    """
    each: list[dict[str, Score]] = [{} for _ in touches]
    runs = run(touches, folder, threads)
    for traces, listed in zip(runs, trace_batch(runs), strict=True):
        for touch, mine, trace in zip(touches, each, listed, strict=True):
            for name, score in score_touch(trace).items():
                if name not in mine or score.score > mine[name].score:
                    mine[name] = score
            if notes and trace is not None:
                _look_for_notes(touch, trace, folder, results)
        for lane, error in traces.failed.items():
            results.failed.append((touches[lane], error))
    return each


def _look_for_notes(touch: Touch, trace: Trace, folder: Path, results: Results) -> None:
    """Look for the notes of a touch that is the first of its surface and body to be out of range for a reason."""
    setting = touch.setting
    known = {reason for *of, reason in results.noted if of == [setting.surface, setting.body]}
    if why := reasons(trace, setting.mesh(), known):
        texts = collect_notes(touch, folder)
        for reason in why:
            results.noted[setting.surface, setting.body, reason] = (touch, texts)


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
    rough: float = ROUGH,
    fingers: int | None = None,
    notes: bool = False,
) -> Results:
    """Touch surfaces at random.

    count   touches in all
    folder  of the meshes
    notes   whether to look for notes of touches that are out of the range of a model, each in a separate run
    done    called after each batch with the share of the work

    A setting that the loader or a node refuses is listed in the results.
    """
    results, rng = Results(), np.random.default_rng(seed)
    pairs = paired(surfaces, bodies)
    batch = min(batch, 1 + count // max(1, len(pairs)))  # every surface is touched
    for number, setting in enumerate(draw_settings(surfaces, bodies, rng, rate, rough, fingers)):
        refused = {key for key in results.refused if not results.touches[key]}
        if results.total >= count or len(refused) == len(pairs):
            break
        if (setting.surface, setting.body) in refused:
            continue
        own = np.random.default_rng((seed, number))
        size = min(batch, lanes_of(setting, 2.5), count - results.total)
        touches = [replace(draw_touch(setting, own, folder), seed=(seed, number, k)) for k in range(size)]
        key = setting.surface, setting.body
        try:
            for touch, found in zip(touches, run_touches(touches, folder, results, notes=notes), strict=True):
                results.touches[key] += 1
                results.bad[key] += any(score.broken for score in found.values())
                for name, score in found.items():
                    results.add(touch, name, score)
        except PalpateError as error:
            results.refused[key] = str(error)
        done(min(1.0, results.total / count), results)
    return results


def worsen_touch(
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
        near = [touch for _ in range(4 * batch) if _is_reachable(touch := vary_touch(best.touch, size, rng), folder)][
            :batch
        ]
        if not near:
            break
        try:
            found = run_touches(near, folder, unused)
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


def _is_reachable(touch: Touch, folder: Path) -> bool:
    felt = touch.setting.felt(folder)[1]
    return all(reachable(f) and float(felt.find(np.array(f.begin))[3]) > 4.5e-3 for f in touch.fingers)


def vary_touch(touch: Touch, size: float, rng: np.random.Generator) -> Touch:
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
