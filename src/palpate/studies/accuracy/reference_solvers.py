"""Full finite elements as methods, by palpate and other solvers: references, and too slow for a loop.

The step time is that of a load step of the static curve; the touch over time follows from the curve.
"""

from dataclasses import replace
from functools import partial
from types import ModuleType

import numpy as np

from palpate.studies.accuracy import reference, sites
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.outcome import LOOKS, NEAR, Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.sites import ON_KIDNEY, SITES, cells_text, on_path
from palpate.studies.peers import calculix, felupe, mujoco

TICKS = 1000.0  # [Hz] Sample rate of the results
PEERS: dict[str, ModuleType] = {"FElupe": felupe, "CalculiX": calculix, "MuJoCo": mujoco}
"""Solvers by others. To add one: `press_block(block, levels)`, `version()` and `INSTALL` as in `peers.felupe`, its name
here and, in lower case, in `CELLS` and `sites.SOLVERS`."""
CELLS = {"fe": (1, 2, 3, 4), "felupe": (1, 2), "calculix": (1, 2, 3), "mujoco": (1, 2, 3, 4),
         "mujoco, its own material": (1, 2)}  # fmt: skip
"""Cells across the radius of the patch, by the name in `sites.SOLVERS`."""


def missing() -> list[str]:
    """How to install each missing solver."""
    return [f"{name}: {module.INSTALL}" for name, module in PEERS.items() if module.version() is None]


def methods() -> list[Method]:
    """Full FE, and the reference solvers that are installed."""
    installed = {name: version for name, module in PEERS.items() if (version := module.version())}
    return [
        Method("full-FE", "full FE", _press_case, _meshes("fe"), partial(_refuses, "fe")),
        *(Method(name, f"{name} {version}", _press_case, _meshes(name.lower()), partial(_refuses, name.lower()),
                 source=(version,)) for name, version in installed.items()),
    ]  # fmt: skip


def _meshes(name: str) -> tuple[Fidelity, ...]:
    return tuple(
        Fidelity(cells_text(n) + solver.removeprefix(name), settings={"fe": {"cells": n, "solver": solver}},
                 quick=n == 1 and solver == name)
        for solver, counts in CELLS.items() if solver.partition(",")[0] == name for n in counts
    )  # fmt: skip


def _refuses(solver: str, touch: BenchCase) -> str:
    """Reason why a solver does not support a test case, or ""."""
    if touch.body == "half-space":
        return "it receives loads here and solves no contact; a half-space has Hertz's closed form"
    if touch.body == "plate":
        return "the layered fingertip takes minutes: palpate build fe fingertip"
    if touch.body == "organs":
        return "it receives loads here and solves no contact; fe.Pair computes the reference"
    return "" if touch.body == "slab" or solver in ON_KIDNEY else "it has no mesh of the kidney"


def _press_case(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
    solver, cells = str(fidelity.settings["fe"]["solver"]), int(str(fidelity.settings["fe"]["cells"]))
    curves = [sites.compute_curve(replace(SITES[name], cells=cells), solver) for name in on_path(touch.place)]
    curve, at = curves[0], reference.path_of(touch)
    fine = np.arange(round(touch.duration * reference.RATE) + 1) / reference.RATE
    _, _, place, slip = touch.at(fine)
    force, depth, elastic = reference.in_time(touch, curve.force, np.array([c.indentation for c in curves]), at=at)
    every = round(reference.RATE / TICKS)
    values = {name: v[::every] for name, v in reference.derive_quantities(touch, slip, force, depth).items()}
    shapes = []
    if touch.body == "slab":
        depth_at = reference.SurfaceShape(curve.force, curve.x, curve.y, curve.shape)
        x, y = np.meshgrid(np.linspace(-NEAR, NEAR, 17), np.linspace(-NEAR, NEAR, 17))
        near = np.stack([x.ravel(), y.ravel()], axis=1)
        near = near[np.hypot(*near.T) < NEAR]
        shapes = [
            (float(fine[k]), near + (place[k], 0.0), depth_at(near + (at[0], 0.0), float(elastic[k])))
            for k in np.linspace(0, len(fine) - 1, LOOKS + 2).astype(int)[1:-1]
        ]
    return MethodOutcome(fine[::every], values, shapes, np.concatenate([c.seconds for c in curves]), None, 0.0)
