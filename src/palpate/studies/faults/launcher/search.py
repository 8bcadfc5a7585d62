"""Draw runs with faults of processes, judge each, and reduce those that break an invariant."""

from __future__ import annotations

import contextlib
import gc
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from time import perf_counter

from palpate.studies.faults.launcher.judge import judge
from palpate.studies.faults.launcher.outcome import Outcome
from palpate.studies.faults.launcher.run import simulate
from palpate.studies.faults.launcher.scene import Fault, Scene, draw_scene
from palpate.studies.faults.reduced import reduce_faults

KEPT = 10  # of each invariant


@dataclass(frozen=True)
class Found:
    """A seed that breaks an invariant.

    faults  the fewest that still break it
    events  the last ones
    """

    seed: int
    invariant: str
    text: str
    scene: Scene
    faults: tuple[str, ...]
    events: tuple[str, ...]


@dataclass
class Results:
    """What a search found: number of seeds, of faults by kind, and of broken invariants; duration [s]."""

    seeds: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    found: list[Found] = field(default_factory=list)
    duration: float = 0.0


@contextlib.contextmanager
def _settled_memory() -> Iterator[None]:
    """Exclude what exists from garbage collection, with which each run on the real clock begins."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def search(seed: int, count: int, done: Callable[[float, Results], None] = lambda share, results: None) -> Results:
    """Judge the seeds from `seed` on; `done` is called after each with the share of the work."""
    results, begun = Results(), perf_counter()
    with _settled_memory():
        for number in range(seed, seed + count):
            scene = draw_scene(number)
            outcome = simulate(scene)
            results.seeds += 1
            results.kinds.update(struck.fault.kind for struck in outcome.struck)
            for name, text in judge(outcome).items():
                results.broken[name] += 1
                if results.broken[name] <= KEPT:
                    results.found.append(_reduced(scene, name, text, outcome))
            results.duration = perf_counter() - begun
            done(results.seeds / count, results)
    return results


def _reduced(scene: Scene, name: str, text: str, outcome: Outcome) -> Found:
    def breaks(fewer: list[Fault]) -> Outcome | None:
        if scene.ticks is None and not any(fault.kind == "interrupt" for fault in fewer):
            return None  # nothing else ends this run
        tried = simulate(scene.but(tuple(fewer)))
        return tried if name in judge(tried) else None

    left, outcome = reduce_faults(scene.faults, outcome, breaks)
    text = judge(outcome).get(name, text)
    return Found(scene.seed, name, text, scene, tuple(map(str, left)), outcome.events)
