"""Draw faults without end, judge each touch that suffers them, and reduce those that break an invariant."""

from __future__ import annotations

import random
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from palpate.nodes.controller import Haptic
from palpate.studies.faults.chain import Chain
from palpate.studies.faults.draw import Touch, draw_faults, draw_touch, draw_two
from palpate.studies.faults.fault import Fault, suffer
from palpate.studies.faults.judge import judge
from palpate.studies.faults.reduced import reduce_faults
from palpate.studies.faults.touch import Felt, feel
from palpate.studies.organs.score import Score

BLOCK = 20  # seeds of one touch, whose nodes are started once
LEAST = 0.2  # [N] of the contact force of a touch
KEPT = 10
EVENTS = 50


@dataclass(frozen=True)
class Found:
    """A seed with its worst invariant.

    faults  in words; of a broken one the fewest that still break it
    events  the last before the largest force, of a broken one
    """

    seed: int
    invariant: str
    score: Score
    touch: Touch
    faults: tuple[str, ...]
    events: tuple[str, ...] = ()


@dataclass
class Results:
    """What a search found: number of seeds, of faults by kind, of broken ones and the worst by invariant."""

    seeds: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    worst: dict[str, list[Found]] = field(default_factory=dict)

    def add(self, found: Found) -> None:
        listed = self.worst.setdefault(found.invariant, [])
        listed.append(found)
        listed.sort(key=lambda one: -one.score.score)
        del listed[KEPT:]


def search(
    seed: int, count: int, done: Callable[[float, Results], None] = lambda share, results: None, fingers: int = 1
) -> Results:
    """Judge the seeds from `seed` on, of touches with one finger or two; `done` is called after each with the share of
    the work."""
    results = Results()
    for number, touch, run, base in _seeds(seed, count, fingers):
        faults = draw_faults(run, touch, random.Random(f"faults {number}"))
        scores = judge(run, touch, faults, base)
        results.seeds += 1
        results.kinds.update(fault.kind for fault in faults)
        for name, score in scores.items():
            found = Found(number, name, score, touch, tuple(map(str, faults)))
            if score.broken:
                results.broken[name] += 1
                found = _reduced(found, run, faults, base)
            results.add(found)
        done(results.seeds / count, results)
    return results


def _seeds(first: int, count: int, fingers: int = 1) -> Iterator[tuple[int, Touch, Chain, Felt]]:
    """Each seed with its touch, the chain that computes it, and what is felt without faults."""
    touch = None
    for number in range(first, first + count):
        if touch is None or number % BLOCK == 0:
            touch, run, base = _touch(random.Random(f"touch {number // BLOCK}"), fingers)
        yield number, touch, run, base


def _touch(random_: random.Random, fingers: int) -> tuple[Touch, Chain, Felt]:
    """A touch that the device can display: the contact force of each finger is at most the controller's limit."""
    while True:
        touch = draw_two(random_) if fingers == 2 else draw_touch(random_)
        run = Chain(touch.launch())
        base = feel(run, round(touch.duration * touch.rate))
        if all(LEAST < each.contact <= Haptic.limit for each in base.hands):
            return touch, run, base


def _reduced(found: Found, run: Chain, faults: Sequence[Fault], base: Felt) -> Found:
    """The same with the fewest of the faults that still break the invariant, by leaving out one after the other."""

    def breaks(fewer: list[Fault]) -> Score | None:
        score = judge(run, found.touch, fewer, base).get(found.invariant) if fewer else None
        return score if score is not None and score.broken else None

    left, score = reduce_faults(faults, found.score, breaks)
    events = _last_events(run, found.touch, left)
    return replace(found, score=score, faults=tuple(map(str, left)), events=events)


def _last_events(run: Chain, touch: Touch, faults: Sequence[Fault]) -> tuple[str, ...]:
    """What happened before the largest force, or at the end."""
    ticks = round(touch.duration * touch.rate)
    worst = suffer(run, faults, ticks).worst
    run.events = deque(maxlen=EVENTS)
    try:
        suffer(run, faults, min(worst + 2, ticks))
        return tuple(f"{tick / touch.rate:.4f} s  {event} {where}" for tick, event, where in run.events)
    finally:
        run.events = None
