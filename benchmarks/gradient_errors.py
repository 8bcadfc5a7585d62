"""Derivatives of every shipped graph by random settings, against Richardson's limit of separate runs.

    python benchmarks/gradient_errors.py [--settings 30] [--graphs kidney pinch ...] [--duration 1.8] [--seed 0]

The derivatives of all forces of contacts and friction over time, by `Ensemble.gradient`, are compared with the limits
of central differences of other runs, at other steps. Candidates are all settings of nodes that run, with the numbers in
lists, such as points and times of the path of a hand; up to 30 of those with an effect on a force are compared. A limit
has an error too: its change by the last extrapolation and the noise of the forces. It is subtracted; where it is above
1e-4 of the RMS derivative, nothing is known, and the time does not count. Prints for each graph how many settings were
compared, the share of the times at which their derivatives settle, the deviation at the worst of them over the RMS of
the derivative, and the reasons for those that do not settle. Takes an hour. Exit code 1: a deviation above 1e-4.
"""

import argparse
import json
import random
import re
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

import palpate
from palpate.engine.faults import GraphError
from palpate.gradients.differences import FLOOR
from palpate.gradients.parameters import Parameter, find_parameter, put_all
from palpate.launch.load.checks.agreeing import mark_of
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load
from palpate.messages import Contact, Friction
from palpate.messages.record import layout
from palpate.nodes.base import settings
from palpate.physics.errors import ArgumentError, PalpateError

STEPS = np.array([1.2e-2, 3e-3, 7.5e-4, 1.875e-4])  # [1] of the reference, over the scale
NOISE = 1e-10  # [N] of a force, ten times that of the kidney
GOAL = 1e-4
NEAR = 21  # ticks around a time whose largest change counts, because steps may agree by chance at one
FORCES = ("force", "forces", "load", "mean")
BUILT = ("width", "refine", "spacing")  # settings that change meshes


class Outcome(NamedTuple):
    """Of a setting: largest deviation over the RMS derivative, share of the times that settle, why others do not."""

    path: str
    deviation: float
    settled: float
    reasons: list[str]


def forces_of(graph) -> list[str]:
    """Fields with the forces of contacts and friction; without one, the first field with a force."""
    named = [
        f"{stream}.{name}" for stream, kind in graph.streams.items() for name in FORCES
        if name in (layout(kind).names or ()) and layout(kind)[name].base.fields is None
        and layout(kind)[name].base.kind == "f"
    ]  # fmt: skip
    touching = [path for path in named if issubclass(graph.streams[path.rpartition(".")[0]], Contact | Friction)]
    return touching or named[:1]


def numbers(path: str, value) -> Iterator[str]:
    """Paths of the numbers in a setting."""
    if type(value) is float:
        yield path
    elif isinstance(value, list | tuple):
        for place, each in enumerate(value):
            yield from numbers(f"{path}[{place}]", each)
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from numbers(f"{path}.{key}", float(each) if isinstance(each, int) else each)


def settings_of(graph, running: set[str]) -> list[str]:
    """Paths of the numbers in settings of nodes that run; of those that describe one thing, one."""
    paths, taken = [], set()
    for node in sorted(running & set(graph.nodes)):
        for setting, value in graph.nodes[node].settings.items():
            mark = mark_of(settings(graph.nodes[node].cls)[setting])
            if setting in BUILT or (mark and setting in taken):
                continue
            taken |= {setting} if mark else set()
            paths += numbers(f"{node}.{setting}", value)
    return paths


def varying(graph, name: str, sets: list[str], running: set[str], paths: list[str]) -> list[Parameter]:
    """Those of the settings with a derivative on both sides of their value."""
    found = []
    for path in paths:
        try:
            one = find_parameter(graph, path, running)
            if one.side(1.1 * STEPS[0] * one.scale, one.value) == 0:
                moved = json.dumps(one.put(one.value + 1e-3 * one.scale))
                load(name, overrides=[*sets, f"{one.target}={moved}"])
                found.append(one)
        except (ArgumentError, GraphError):  # 0 without a scale, frozen by a basis, or tied to another setting
            continue
    return found


def columns_of(found: list[Parameter], moves: list[tuple[Parameter, float]]) -> dict[str, list]:
    """By target its value in each lane; a lane moves one of the parameters by a part of its scale."""
    columns: dict[str, list] = {one.target: [] for one in found}
    for one, step in moves:
        moved = put_all([one], [one.value + step * one.scale])
        for target, column in columns.items():
            column.append(moved.get(target, next(o.container for o in found if o.target == target)))
    return columns


def felt(name: str, fields: list[str], sets: list[str], duration: float, found: list[Parameter]) -> list[Parameter]:
    """The parameters of which a change by the largest step changes a force; without this lane for each, most lanes of
    the derivatives would be of settings without effect."""
    if not found:
        return []
    moves = [(found[0], 0.0), *((one, STEPS[0]) for one in found)]
    result = palpate.Ensemble(name, len(moves), columns_of(found, moves), fields, sets=sets, duration=duration)
    made = [values.values for values in map(result.run(quiet=True).__getitem__, fields)]
    return [one for k, one in enumerate(found, 1) if any((each[k] != each[0]).any() for each in made)]


def limits(name: str, fields: list[str], sets: list[str], duration: float, found: list[Parameter]):
    """By field, Richardson's limits (settings, time, ...) of separate runs, and their errors."""
    columns = columns_of(found, [(one, step) for one in found for step in np.outer(STEPS, (1.0, -1.0)).ravel()])
    lanes = 2 * len(STEPS) * len(found)
    result = palpate.Ensemble(name, lanes, columns, fields, sets=sets, duration=duration).run(quiet=True)
    made = {}
    for field in fields:
        force = result[field].values.reshape(len(found), len(STEPS), 2, *result[field].shape[1:])
        size = np.array([one.scale for one in found]).reshape(-1, *[1] * (force.ndim - 3))
        d = [(force[:, j, 0] - force[:, j, 1]) / (2.0 * step * size) for j, step in enumerate(STEPS)]
        tables = [richardson(d[j : j + 3], NOISE / (size * STEPS[j + 2])) for j in range(len(STEPS) - 2)]
        (coarse, change), (fine, doubt) = tables
        # a kink between the steps leaves each table without a change, but not between them
        change = np.maximum(change, maximum_filter1d(np.abs(coarse - fine), NEAR, axis=1))
        made[field] = np.where(change < doubt, coarse, fine), np.minimum(change, doubt)
    return made


def richardson(slopes, noise):
    """The limit of three slopes (settings, time, ...), whose steps fall by a factor of 4, and its error."""
    first, second = ((16.0 * slopes[i + 1] - slopes[i]) / 15.0 for i in (0, 1))
    return (256.0 * second - first) / 255.0, maximum_filter1d(np.abs(second - first), NEAR, axis=1) + noise


def check(name: str, given) -> tuple[list[Outcome], int]:
    """Of the settings with an effect; number of the settings that were tried. PalpateError: impossible."""
    graph = load(name)
    sets = ["scene.hand.ideal=true"] if "hand" in graph.scene else []
    fields = forces_of(graph)
    if not fields:
        raise ArgumentError("no force")
    touch = palpate.Ensemble(name, 1, {}, fields, sets=sets, duration=given.duration)
    running = {node.name for node in touch._prepared[0].job.nodes}
    graph = load(name, overrides=sets)
    paths = settings_of(graph, running)
    random.Random(given.seed).shuffle(paths)
    outcomes, candidates, drawn = [], 0, 0
    while drawn < len(paths) and len(outcomes) < given.settings:
        batch = varying(graph, name, sets, running, paths[drawn : drawn + given.settings])
        drawn, candidates = drawn + given.settings, candidates + len(batch)
        found = felt(name, fields, sets, given.duration, batch)
        if not found:
            continue
        derived = touch.gradient([one.path for one in found], quiet=True).isel(lane=0)
        known = limits(name, fields, sets, given.duration, found)
        for k, one in enumerate(found):
            each = [compare(derived, known[field], field, k, one.scale) for field in fields]
            each = [result for result in each if result is not None]
            if each and len(outcomes) < given.settings:
                deviations = [result[0] for result in each if not np.isnan(result[0])]
                reasons = [result[2] for result in each if result[2]]
                settled = float(np.mean([result[1] for result in each]))
                outcomes.append(Outcome(one.path, max(deviations, default=np.nan), settled, reasons))
    return outcomes, candidates


def compare(derived, known, field: str, k: int, scale: float):
    """Deviation, share of the times that settle, and reason of one derivative; None: no effect."""
    derivative, error = derived[f"{field}.derivative"].values[k], derived[f"{field}.error"].values[k]
    limit, doubt = known[0][k], known[1][k]
    force = float(np.sqrt(np.mean(derived[field].values ** 2)))
    size = float(np.sqrt(np.mean(limit[np.isfinite(limit)] ** 2)))
    settled = np.isfinite(derivative)
    unlike = np.abs(derivative - limit) - doubt
    if size <= 10.0 * FLOOR * force / scale:  # equal: an organ that is not touched
        wrong = (unlike - error)[settled].max(initial=0.0) > FLOOR * force / scale
        return (np.inf, settled.mean(), "has an effect") if wrong else None
    sure = settled & (doubt < GOAL * size)
    deviation = float(unlike[sure].max(initial=0.0)) / size if sure.any() else np.nan
    if sure.any() and (unlike - error)[sure].max() > GOAL * size:
        deviation = max(deviation, 2.0 * GOAL)  # more than the stated error
    return deviation, float(settled.mean()), str(derived[f"{field}.reason"].values[k])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--settings", type=int, default=30)
    parser.add_argument("--graphs", nargs="+", default=sorted(path.stem for path in GRAPHS.glob("*.yaml")))
    parser.add_argument("--duration", type=float, default=1.8)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    compared, above = 0, 0
    for name in given.graphs:
        try:
            outcomes, tried = check(name, given)
        except PalpateError as error:
            print(f"{name}: left out: {' '.join(str(error).split())[:110]}", flush=True)
            continue
        known = sorted((each for each in outcomes if not np.isnan(each.deviation)), key=lambda each: -each.deviation)
        compared, above = compared + len(known), above + sum(each.deviation > GOAL for each in known)
        kinds = Counter(
            kind for each in outcomes
            for kind in {re.sub(r" \(.*", "", text.partition("settle: ")[2] or text.partition(";")[0])
                         for text in each.reasons}
        )  # fmt: skip
        shown = ", ".join(f"{each.deviation:.1e} {each.path}" for each in known[:2])
        why = ", ".join(f"{count} {text}" for text, count in kinds.most_common())
        share = f"{100 * np.mean([each.settled for each in outcomes]):.1f} %" if outcomes else "none"
        unknown = ", ".join(each.path for each in outcomes if np.isnan(each.deviation))
        print(
            f"{name}: {tried} candidates, {len(outcomes)} with an effect, {len(known)} compared; "
            f"{sum(not each.reasons for each in outcomes)} settle at all times, {share} of all times; worst {shown}; "
            f"not compared {unknown or 'none'}; NaN at some times: {why or 'none'}",
            flush=True,
        )
    print(f"{compared} settings compared, {above} with a deviation above {GOAL:g}")
    sys.exit(1 if above else 0)


if __name__ == "__main__":
    main()
