"""Full finite elements as methods: too slow for a loop, and what the fast models are held against.

A load step of the static curve is the step that is priced; the touch over time follows from the curve.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from palpate.studies.accuracy import UnsupportedError, halfspace, places, truth
from palpate.studies.accuracy.outcome import LOOKS, NEAR, Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.places import ON_KIDNEY, PLACES, cells_text, on_path
from palpate.studies.accuracy.touches import BenchCase
from palpate.studies.peers import MissingError, calculix, felupe, mujoco

TICKS = 1000.0
"""[Hz] At which the touch is told."""
CELLS = (1, 2, 3, 4)
"""Across the radius, of full FE."""


@dataclass(frozen=True)
class Outside:
    """A solver that others wrote.

    name, method  in tables, and of the method
    version       of what is installed, None where it is not;  install  what to type then
    cells         across the radius, by the name of its curves in `places.SOLVERS`
    apart         what sets curves apart from the first where there are several
    """

    name: str
    method: str
    version: Callable[[], str | None]
    install: str
    cells: dict[str, tuple[int, ...]]
    apart: dict[str, str] = field(default_factory=dict)


OUTSIDE = (
    Outside("FElupe", "FElupe", felupe.version, felupe.INSTALL, {"felupe": (1, 2)}),
    Outside("CalculiX", "CalculiX", calculix.version, calculix.INSTALL, {"calculix": (1, 2, 3)}),
    Outside("MuJoCo flex", "MuJoCo", mujoco.version, mujoco.INSTALL, {"mujoco": (1, 2, 3, 4), "mujoco-own": (1, 2)},
            {"mujoco-own": "its own material"}),
)  # fmt: skip
"""To add one: `press(block, levels) -> Curve` as in `peers.felupe`, its name in `places.SOLVERS`, a line here."""


def missing() -> list[str]:
    """How to install those outside solvers that are not."""
    return [f"{one.name}: {one.install}" for one in OUTSIDE if one.version() is None]


def check(method: str) -> None:
    """MissingError: a method whose solver is not installed."""
    for one in OUTSIDE:
        if one.method == method and one.version() is None:
            raise MissingError(f"method: {one.method} is not installed, or too old; {one.install}")


def methods() -> list[Method]:
    """Full FE, and the outside solvers that are installed."""
    finer = tuple(_cut("fe", cells) for cells in CELLS)
    known = [Method("full-FE", "full FE", _full, finer, _of_body)]
    for one in OUTSIDE:
        version = one.version()
        if version is not None:
            cuts = [_cut(solver, n, one.apart.get(solver, "")) for solver, own in one.cells.items() for n in own]
            known.append(Method(one.method, f"{one.name} {version}", _of_solver, tuple(cuts), _only(one), (version,)))
    return known


def _cut(solver: str, cells: int, apart: str = "") -> Fidelity:
    """A mesh of a solver; one that is set apart is no refinement of the others."""
    settings: dict[str, dict[str, object]] = {"fe": {"cells": cells, "solver": solver}}
    text = f"{cells_text(cells)}, {apart}" if apart else cells_text(cells)
    return Fidelity(text, "form" if apart else "mesh", settings=settings, quick=cells == 1 and not apart)


def _of_body(touch: BenchCase) -> str:
    return "the layered fingertip takes minutes: palpate build fe fingertip" if touch.body == "plate" else ""


def _only(one: Outside) -> Callable[[BenchCase], str]:
    """What it is given: loads on the slab, and where it has curves of it on the kidney."""
    kidney = set(one.cells) & set(ON_KIDNEY)

    def refuses(touch: BenchCase) -> str:
        if touch.body == "kidney":
            return "" if kidney else f"{one.name} is given no kidney here"
        return "" if touch.body == "slab" else f"{one.name} is given loads here, and no contact"

    return refuses


def _full(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
    if touch.body == "half-space":
        return _ball(touch, int(str(fidelity.settings["fe"]["cells"])))
    return _of_solver(touch, fidelity, repeats)


def _of_solver(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
    solver, cells = str(fidelity.settings["fe"]["solver"]), int(str(fidelity.settings["fe"]["cells"]))
    if not set(on_path(touch.place)) <= set(PLACES):
        raise UnsupportedError(f"place {touch.place!r} is not known")
    blocks = [replace(PLACES[name], cells=cells) for name in on_path(touch.place)]
    curves = [places.computed(block, solver) for block in blocks]
    curve, base = curves[0], blocks[0]
    fine = np.arange(round(touch.duration * truth.RATE) + 1) / truth.RATE
    _, _, place, slip = touch.at(fine)
    depths, at = np.array([c.indentation for c in curves]), truth.path_of(touch)
    force, depth, elastic = truth.in_time(touch, curve.force, depths, at=at)
    every = round(truth.RATE / TICKS)
    values = truth.derived(touch, slip, force, depth)
    shapes = []
    if touch.body == "slab":
        dent = truth.Dent(curve.force, curve.x, curve.y, curve.shape)
        x, y = np.meshgrid(np.linspace(-NEAR, NEAR, 17), np.linspace(-NEAR, NEAR, 17))
        own = np.stack([x.ravel(), y.ravel()], axis=1)
        own = own[np.hypot(*own.T) < NEAR]
        for k in np.linspace(0, len(fine) - 1, LOOKS + 2).astype(int)[1:-1]:
            shapes.append((float(fine[k]), own + (place[k], 0.0), dent(own + (base.place, 0.0), float(elastic[k]))))
    seconds = np.concatenate([c.seconds for c in curves])
    return MethodOutcome(fine[::every], {name: v[::every] for name, v in values.items()}, shapes, seconds, None, 0.0)


@lru_cache(maxsize=8)
def _pressed(faces: int) -> tuple[halfspace.HalfSpaceResult, float]:
    begun = time.perf_counter()
    pressed = halfspace.press(faces)
    return pressed, time.perf_counter() - begun - float(pressed.seconds.sum())


def _ball(touch: BenchCase, faces: int) -> MethodOutcome:
    """Between the depths force and area follow Hertz's powers, which linear elasticity without friction has exactly."""
    pressed, offline = _pressed(faces)
    times = np.arange(round(touch.duration * TICKS) + 1) / TICKS
    approach, *_ = touch.at(times)
    depth = np.maximum(approach, 0.0)
    ratio = pressed.force / halfspace.DEPTHS**1.5
    force = depth**1.5 * np.interp(depth, halfspace.DEPTHS, ratio)
    area = depth * np.interp(depth, halfspace.DEPTHS, pressed.area / halfspace.DEPTHS)
    values = {"force": force, "indentation": depth, "area": area, "energy": truth.worked(force, depth)}
    return MethodOutcome(times, values, [], pressed.seconds, None, offline)
