"""All relations of a finger with a width, as a list of tasks whose results are kept, so that a search resumes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.errors import PalpateError
from palpate.studies.kept import adding_lines, kept_lines
from palpate.studies.organs import widths
from palpate.studies.organs.score import Score
from palpate.studies.organs.search import Found
from palpate.studies.organs.settings import WITH_BASIS
from palpate.studies.organs.slides import slides
from palpate.studies.organs.touches import Finger, Setting, Touch
from palpate.studies.organs.zoo import GAPPED, Specimen

Task = Callable[[np.random.Generator], list[Found]]


def tasks_of(
    specimens: Sequence[Specimen], bodies: Sequence[str], count: int, folder: Path, extra: Sequence[str] = ()
) -> dict[str, Task]:
    """The relations of the block, of each surface with each body, and of bodies with gaps, by name: functions of a
    random generator that return what was found in `count` touches of each.

    extra  values of `--set` for bodies with gaps
    """

    def of(relation: Callable[..., list[Found]], *given: Any, more: Sequence[str] = extra) -> Task:
        return lambda rng: relation(*given, count, rng, folder, *([more] if more else []))

    tasks: dict[str, Task] = {}
    for body in (name for name in bodies if name not in WITH_BASIS):
        tasks[f"block {body}"] = of(widths.block_relations, body)
        tasks[f"slides {body}"] = of(slides, body)
        tasks[f"fissure {body}"] = of(widths.fissure, body)
        tasks[f"overlaps {body}"] = of(widths.overlaps, body)
        tasks |= {f"merged {s.name} {body}": of(widths.merged, s, body) for s in specimens if not s.patch}
        for one in specimens:
            if one.name in widths.CONVEX:
                tasks[f"same {one.name} {body}"] = of(widths.same, one, body, more=())
        tasks |= {f"spun {name} {body}": of(widths.spun, name, body, more=()) for name in widths.SEAMS}
    tasks |= {f"again {name}": partial(_again, name) for name in GAPPED}
    return tasks


def _again(surface: str, rng: np.random.Generator) -> list[Found]:
    return widths.again(surface)


def compare_widths(
    specimens: Sequence[Specimen],
    bodies: Sequence[str],
    count: int,
    seed: int,
    folder: Path,
    extra: Sequence[str] = (),
    results: Path | None = None,
) -> Iterator[tuple[float, list[Found], str]]:
    """Run the tasks: the share of the work that is done, what a task found, and why it was refused ("": it was not).

    results  file to which each task adds a line. Tasks of this seed and number of touches that it has are not run
             again, so it must be of the same version
    """
    tasks, known = tasks_of(specimens, bodies, count, folder, extra), _stored(results, seed, count)
    with nullcontext() if results is None else adding_lines(results) as add:
        for number, (name, task) in enumerate(tasks.items(), 1):
            if name not in known:
                try:
                    known[name] = task(np.random.default_rng([seed, *name.encode()])), ""
                except PalpateError as error:  # too thin for the layers of the body, or not a solid
                    known[name] = [], str(error)
                if add is not None:
                    listed, why = known[name]
                    found = [asdict(each) for each in listed]
                    add({"seed": seed, "count": count, "task": name, "refused": why, "found": found})
            yield number / len(tasks), *known[name]


def _stored(path: Path | None, seed: int, count: int) -> dict[str, tuple[list[Found], str]]:
    """What the tasks of a file found; lines of another kind are left out."""
    known: dict[str, tuple[list[Found], str]] = {}
    for line in kept_lines(path) if path is not None else ():
        with suppress(TypeError, KeyError):
            if (line["seed"], line["count"]) == (seed, count):
                known[line["task"]] = [_found(each) for each in line["found"]], line["refused"]
    return known


def _found(plain: dict[str, Any]) -> Found:
    touch, setting = plain["touch"], plain["touch"]["setting"]
    setting |= {name: tuple(setting[name]) for name in ("rotation", "more")}
    fingers = (Finger(tuple(f["begin"]), tuple(f["origin"]), tuple(f["path"])) for f in touch["fingers"])
    return Found(
        Touch(Setting(**setting), tuple(fingers), tuple(touch["seed"])), plain["invariant"], Score(**plain["score"])
    )
