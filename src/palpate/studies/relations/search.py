"""Draw scenes without end, state each relation about each, and keep those that do not hold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.physics.errors import ArgumentError
from palpate.studies.organs.score import Score
from palpate.studies.relations.draw import BODIES, draw_case, draw_setting
from palpate.studies.relations.relation import Case, Claim, Relation
from palpate.studies.relations.runs import Run, Runner, Trace

BATCH = 12  # scenes that share started nodes
BARREN = 10  # batches
KEPT = 10  # worst of each relation


@dataclass(frozen=True)
class Found:
    """The score of a relation in a scene, and its runs."""

    relation: str
    score: Score
    runs: tuple[Run, ...]
    case: Case


@dataclass
class Results:
    """What a search found.

    stated   number of comparisons by relation
    broken   number of those that do not hold
    worst    the worst of each
    refused  runs that were refused or failed, by relation and reason, with their number and one command
    """

    stated: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    worst: dict[str, list[Found]] = field(default_factory=dict)
    refused: dict[tuple[str, str], tuple[int, str]] = field(default_factory=dict)

    def add(self, found: Found) -> None:
        self.stated[found.relation] += 1
        self.broken[found.relation] += found.score.broken
        listed = self.worst.setdefault(found.relation, [])
        listed.append(found)
        listed.sort(key=lambda one: -one.score.score)
        del listed[KEPT:]

    def refuse(self, relation: str, why: str, run: Run) -> None:
        reason = why.splitlines()[0]
        count, command = self.refused.get((relation, reason), (0, run.command()))
        self.refused[relation, reason] = (count + 1, command)

    @property
    def total(self) -> int:
        return self.stated.total()


def search(
    relations: Sequence[Relation],
    count: int,
    seed: int,
    folder: Path,
    done: Callable[[float, Results], None] = lambda share, results: None,
    threads: int | None = None,
    bodies: Mapping[str, float] = BODIES,
) -> Results:
    """State relations about random scenes, until there are `count` comparisons.

    folder  of the meshes
    bodies  that are drawn, and their shares
    done    called after each batch with the share of the work

    ArgumentError: `BARREN` batches, one after the other, had nothing to compare.
    """
    results, batch, barren = Results(), 0, 0
    while results.total < count:
        before = results.total
        rng = np.random.default_rng((seed, batch))
        setting = draw_setting(rng, bodies)
        with Runner(threads) as runner:
            claims = []
            for case in (draw_case(setting, rng, folder, batch) for _ in range(BATCH)):
                for relation in relations:
                    if rng.uniform() < relation.share and (claim := relation.claim(case, rng)) is not None:
                        claims.append((relation, case, claim))
            _judge(claims[: count - results.total], runner, results)
        batch += 1
        barren = 0 if results.total > before else barren + 1
        if barren == BARREN:
            raise ArgumentError(_barren(relations, bodies, results))
        done(min(1.0, results.total / count), results)
    return results


def _barren(relations: Sequence[Relation], bodies: Mapping[str, float], results: Results) -> str:
    names = ", ".join(one.name for one in relations)
    why = next((f"; {name}: {reason}" for name, reason in results.refused), "")
    return (
        f"bench relations: {BARREN * BATCH} scenes had nothing to compare: {names} with {', '.join(bodies)}{why}. "
        "docs/proof.md says which scenes a relation is about; leave out --relation or --body"
    )


def _judge(claims: Sequence[tuple[Relation, Case, Claim]], runner: Runner, results: Results) -> None:
    """Run each different run once, and judge each claim."""
    runs = {one.command() + one.tag: one for _, _, claim in claims for one in claim.runs}
    known: dict[str, Trace] = dict(zip(runs, runner.run(list(runs.values())), strict=True))
    for relation, case, claim in claims:
        traces = [known[one.command() + one.tag] for one in claim.runs]
        failed = next((k for k, trace in enumerate(traces) if trace.error), None)
        if failed is not None:
            results.refuse(relation.name, traces[failed].error, claim.runs[failed])
            continue
        results.add(Found(relation.name, claim.judge(*traces), claim.runs, case))
