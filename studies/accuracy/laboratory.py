"""Full finite elements as methods, ours and others': too slow for a loop, and what the fast models are held against.

A load step of the static curve is the step that is priced; the touch over time follows from the curve.
"""

from dataclasses import replace
from functools import partial
from types import ModuleType

import numpy as np

from palpate.studies.accuracy import places, truth
from palpate.studies.accuracy.outcome import LOOKS, NEAR, Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.places import ON_KIDNEY, PLACES, cells_text, on_path
from palpate.studies.accuracy.touches import BenchCase
from palpate.studies.peers import calculix, felupe, mujoco

TICKS = 1000.0  # [Hz] At which the touch is told
OUTSIDE: dict[str, ModuleType] = {"FElupe": felupe, "CalculiX": calculix, "MuJoCo": mujoco}
"""Solvers that others wrote. To add one: `press(block, levels)`, `version()` and `INSTALL` as in `peers.felupe`; its
name here and, in lower case, in `CELLS` and `places.SOLVERS`."""
CELLS = {"fe": (1, 2, 3, 4), "felupe": (1, 2), "calculix": (1, 2, 3), "mujoco": (1, 2, 3, 4),
         "mujoco, its own material": (1, 2)}  # fmt: skip
"""Across the radius, by the name in `places.SOLVERS`."""


def missing() -> list[str]:
    """How to install those outside solvers that are not."""
    return [f"{name}: {module.INSTALL}" for name, module in OUTSIDE.items() if module.version() is None]


def methods() -> list[Method]:
    """Full FE, and the outside solvers that are installed."""
    known = [Method("full-FE", "full FE", _pressed, _meshes("fe"), partial(_refuses, "fe"))]
    for name, module in OUTSIDE.items():
        if version := module.version():
            own = name.lower()
            title = f"{name} {version}"
            known.append(Method(name, title, _pressed, _meshes(own), partial(_refuses, own), source=(version,)))
    return known


def _meshes(name: str) -> tuple[Fidelity, ...]:
    return tuple(
        Fidelity(cells_text(n) + solver.removeprefix(name), settings={"fe": {"cells": n, "solver": solver}},
                 quick=n == 1 and solver == name)
        for solver, counts in CELLS.items() if solver.partition(",")[0] == name for n in counts
    )  # fmt: skip


def _refuses(solver: str, touch: BenchCase) -> str:
    """Why a solver does not compute a touch; empty: it does."""
    if touch.body == "half-space":
        return "only loads are given to it, no contact; a half-space has a closed form: Hertz's"
    if touch.body == "plate":
        return "the layered fingertip takes minutes: palpate build fe fingertip"
    return "" if touch.body == "slab" or solver in ON_KIDNEY else "it is given no kidney"


def _pressed(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
    solver, cells = str(fidelity.settings["fe"]["solver"]), int(str(fidelity.settings["fe"]["cells"]))
    curves = [places.computed(replace(PLACES[name], cells=cells), solver) for name in on_path(touch.place)]
    curve, at = curves[0], truth.path_of(touch)
    fine = np.arange(round(touch.duration * truth.RATE) + 1) / truth.RATE
    _, _, place, slip = touch.at(fine)
    force, depth, elastic = truth.in_time(touch, curve.force, np.array([c.indentation for c in curves]), at=at)
    every = round(truth.RATE / TICKS)
    told = {name: v[::every] for name, v in truth.derived(touch, slip, force, depth).items()}
    shapes = []
    if touch.body == "slab":
        dent = truth.Dent(curve.force, curve.x, curve.y, curve.shape)
        x, y = np.meshgrid(np.linspace(-NEAR, NEAR, 17), np.linspace(-NEAR, NEAR, 17))
        near = np.stack([x.ravel(), y.ravel()], axis=1)
        near = near[np.hypot(*near.T) < NEAR]
        shapes = [
            (float(fine[k]), near + (place[k], 0.0), dent(near + (at[0], 0.0), float(elastic[k])))
            for k in np.linspace(0, len(fine) - 1, LOOKS + 2).astype(int)[1:-1]
        ]
    return MethodOutcome(fine[::every], told, shapes, np.concatenate([c.seconds for c in curves]), None, 0.0)
