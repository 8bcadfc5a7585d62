"""Derivatives of every shipped graph by random settings, against Richardson's limit of separate runs.

    python benchmarks/gradient_errors.py [--settings 30] [--graphs kidney pinch ...] [--duration 1.2] [--seed 0]

Each setting's derivative of a force over time, by `Ensemble.gradient`, is compared with the limit of central
differences of other runs, at other steps. The limit has an error too, its change by the last extrapolation and the
noise of the forces, which is subtracted; where it is above 1e-4 of the RMS derivative, nothing is known, and the time
does not count. Prints for each graph how many settings were checked, the deviation at the worst of the times that
settle over the RMS of the derivative, and the reasons for those that do not settle. Takes minutes. Exit code 1: a
deviation above 1e-4.
"""

import argparse
import random
import re
import sys
import warnings
from collections import Counter

import numpy as np
from scipy.ndimage import maximum_filter1d

import palpate
from palpate.engine.faults import GraphError
from palpate.gradients.differences import FLOOR
from palpate.gradients.parameters import find_parameter
from palpate.launch.load.checks.agreeing import mark_of
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load
from palpate.messages.record import layout
from palpate.nodes.base import settings
from palpate.physics.errors import ArgumentError, PalpateError

STEPS = np.array([6e-3, 3e-3, 1.5e-3])  # [1] of the reference, over the value
NOISE = 1e-10  # [N] of a force, ten times that of the kidney
GOAL = 1e-4
NEAR = 21  # ticks around a time whose largest change counts, because steps may agree by chance at one
FORCES = ("force", "forces", "load")
BUILT = ("width", "refine", "spacing")  # settings that change meshes


def force_of(graph) -> str | None:
    """The first field with a force that a contact or a sensor sends."""
    named = [
        f"{stream}.{name}" for stream, kind in graph.streams.items() for name in FORCES
        if name in (layout(kind).names or ()) and layout(kind)[name].base.fields is None
        and layout(kind)[name].base.kind == "f"
    ]  # fmt: skip
    return min(named, key=lambda path: ("contact" not in path.lower(), named.index(path)), default=None)


def settings_of(graph, name: str, sets: list[str], running: set[str]) -> list[str]:
    """Paths of the settings with a derivative on both sides of their value; of those that describe one thing, one."""
    found, taken = [], set()
    for node in sorted(running & set(graph.nodes)):
        for setting, value in graph.nodes[node].settings.items():
            mark = mark_of(settings(graph.nodes[node].cls)[setting])
            if type(value) is not float or value == 0.0 or setting in BUILT or (mark and setting in taken):
                continue
            taken |= {setting} if mark else set()
            path = f"{node}.{setting}"
            try:
                if find_parameter(graph, path, running).side(7e-3 * abs(value), value) == 0:
                    load(name, overrides=[*sets, f"{path}={1.001 * value!r}"])
                    found.append(path)
            except (ArgumentError, GraphError):  # frozen by a basis, or tied to the setting of another node
                continue
    return found


def limits(name: str, field: str, sets: list[str], duration: float, paths: list[str], values: np.ndarray):
    """Richardson's limits (settings, time, ...) of separate runs, and their errors."""
    rows = np.repeat(values[None], 6 * len(paths), axis=0)
    for k in range(len(paths)):
        for j, step in enumerate(STEPS):
            rows[6 * k + 2 * j, k] *= 1.0 + step
            rows[6 * k + 2 * j + 1, k] *= 1.0 - step
    over = {path: rows[:, k] for k, path in enumerate(paths)}
    force = palpate.Ensemble(name, len(rows), over, [field], sets=sets, duration=duration).run(quiet=True)[field].values
    force = force.reshape(len(paths), 3, 2, *force.shape[1:])
    size = values.reshape(-1, *[1] * (force.ndim - 3))
    d = [(force[:, j, 0] - force[:, j, 1]) / (2.0 * STEPS[j] * size) for j in range(3)]
    first, second = ((4.0 * d[j + 1] - d[j]) / 3.0 for j in (0, 1))
    change = maximum_filter1d(np.abs(second - first), NEAR, axis=1)
    return (16.0 * second - first) / 15.0, change + NOISE / np.abs(size * STEPS[-1])


def check(name: str, given) -> tuple[list[tuple[float, str]], int, list[str], str]:
    """Deviations with their settings, number of settings without effect, reasons of what does not settle, the field.
    PalpateError: not possible."""
    graph = load(name)
    sets = ["scene.hand.ideal=true"] if "hand" in graph.scene else []
    field = force_of(graph)
    if field is None:
        raise ArgumentError("no force")
    touch = palpate.Ensemble(name, 1, {}, [field], sets=sets, duration=given.duration)
    running = {node.name for node in touch._prepared[0].job.nodes}
    paths = settings_of(load(name, overrides=sets), name, sets, running)
    paths = random.Random(given.seed).sample(paths, min(given.settings, len(paths)))
    found = touch.gradient(paths, quiet=True).isel(lane=0)
    derivative, error = found[f"{field}.derivative"].values, found[f"{field}.error"].values
    values = found["value"].values
    limit, doubt = limits(name, field, sets, given.duration, paths, values)
    force, worst, idle = float(np.sqrt(np.mean(found[field].values ** 2))), [], 0
    for k, path in enumerate(paths):
        size = float(np.sqrt(np.mean(limit[k][np.isfinite(limit[k])] ** 2)))
        unlike = np.abs(derivative[k] - limit[k]) - doubt[k]
        settled = np.isfinite(derivative[k])
        if size < 10.0 * FLOOR * force / abs(values[k]):
            idle += 1
            if (unlike[settled] > FLOOR * force / abs(values[k])).any():
                worst.append((float("inf"), f"{path}, which has no effect"))
            continue
        known = settled & (doubt[k] < GOAL * size)
        worst.append((float(unlike[known].max(initial=0.0)) / size if known.any() else float("nan"), path))
        if known.any() and (unlike - error[k])[known].max() > GOAL * size:
            worst[-1] = (worst[-1][0], f"{path}, more than its error")
    return worst, idle, [str(text) for text in found[f"{field}.reason"].values], field


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--settings", type=int, default=30)
    parser.add_argument("--graphs", nargs="+", default=sorted(path.stem for path in GRAPHS.glob("*.yaml")))
    parser.add_argument("--duration", type=float, default=1.2)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    checked, above = 0, 0
    for name in given.graphs:
        try:
            worst, idle, reasons, field = check(name, given)
        except PalpateError as error:
            print(f"{name}: left out: {' '.join(str(error).split())[:110]}", flush=True)
            continue
        known = sorted((each for each in worst if not np.isnan(each[0])), reverse=True)
        checked, above = checked + len(worst) + idle, above + sum(size > GOAL for size, _ in known)
        kinds = Counter(
            re.sub(r" \(.*", "", text.partition("settle: ")[2] or text.partition(";")[0]) for text in reasons if text
        )
        shown = ", ".join(f"{size:.1e} {path}" for size, path in known[:2])
        why = ", ".join(f"{count} {text}" for text, count in kinds.most_common())
        print(
            f"{name}, {field}: {len(reasons)} settings, {idle} without effect, {len(known)} compared; "
            f"{sum(not r for r in reasons)} settle at all times; worst {shown}; NaN at some times: {why or 'none'}",
            flush=True,
        )
    print(f"{checked} settings, {above} with a deviation above {GOAL:g}")
    sys.exit(1 if above else 0)


if __name__ == "__main__":
    main()
