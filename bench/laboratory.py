"""Full finite elements as methods: too slow for a loop, and what the fast models are held against.

A load step of the static curve is the step that is priced; the touch over time follows from the curve.
"""

from __future__ import annotations

import time
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from palpate.bench import halfspace, outside, places, truth
from palpate.bench.continuum import Block
from palpate.bench.errors import Refused
from palpate.bench.outcome import LOOKS, NEAR, Fidelity, Outcome
from palpate.bench.places import PLACES
from palpate.bench.touches import Touch

if TYPE_CHECKING:
    from palpate.bench.methods import Method

TICKS = 1000.0
"""[Hz] At which the touch is told."""
CELLS = {"fe": (1, 2, 3, 4), "felupe": (1, 2)}


def methods() -> list[Method]:
    """Full FE, and FElupe where it is installed."""
    from palpate.bench.methods import Method

    def finer(solver: str) -> tuple[Fidelity, ...]:
        return tuple(
            Fidelity(f"{n} cells a radius", "mesh", settings={"fe": {"cells": n}}, quick=n == 1) for n in CELLS[solver]
        )

    known = [Method("full-FE", "full FE", _full, finer("fe"), _of_body)]
    if outside.version() is not None:
        known.append(Method("FElupe", f"FElupe {outside.version()}", _felupe, finer("felupe"), _of_slab))
    return known


def _of_body(touch: Touch) -> str:
    return "the layered fingertip takes minutes: palpate fe fingertip" if touch.body == "plate" else ""


def _of_slab(touch: Touch) -> str:
    return "" if touch.body == "slab" else "FElupe has no contact with a ball"


def _full(touch: Touch, fidelity: Fidelity, repeats: int) -> Outcome:
    cells = int(str(fidelity.settings["fe"]["cells"]))
    if touch.body == "half-space":
        return _ball(touch, cells)
    return _slab(touch, "fe", cells)


def _felupe(touch: Touch, fidelity: Fidelity, repeats: int) -> Outcome:
    return _slab(touch, "felupe", int(str(fidelity.settings["fe"]["cells"])))


def _slab(touch: Touch, solver: str, cells: int) -> Outcome:
    if touch.place not in PLACES:
        raise Refused(f"place {touch.place!r} is not known")
    base = PLACES[touch.place]
    curve = places.computed(Block(base.place, cells, base.nodule), solver)
    fine = np.arange(round(touch.duration * truth.RATE) + 1) / truth.RATE
    _, _, place, slip = touch.at(fine)
    force, depth, elastic = truth.in_time(touch, curve.force, curve.indentation)
    every = round(truth.RATE / TICKS)
    values = truth.derived(touch, fine, slip, force, depth, elastic)
    dent = truth.Dent(curve.force, curve.x, curve.y, curve.shape)
    times, shapes = fine[::every], []
    for k in np.linspace(0, len(fine) - 1, LOOKS + 2).astype(int)[1:-1]:
        x, y = np.meshgrid(np.linspace(-NEAR, NEAR, 17), np.linspace(-NEAR, NEAR, 17))
        own = np.stack([x.ravel(), y.ravel()], axis=1)
        own = own[np.hypot(*own.T) < NEAR]
        shapes.append((float(fine[k]), own + (place[k], 0.0), dent(own + (base.place, 0.0), float(elastic[k]))))
    return Outcome(times, {name: v[::every] for name, v in values.items()}, shapes, curve.seconds, None, 0.0)


@lru_cache(maxsize=8)
def _pressed(faces: int) -> tuple[halfspace.Pressed, float]:
    begun = time.perf_counter()
    pressed = halfspace.press(faces)
    return pressed, time.perf_counter() - begun - float(pressed.seconds.sum())


def _ball(touch: Touch, faces: int) -> Outcome:
    """Between the depths force and area follow Hertz's powers, which linear elasticity without friction has exactly."""
    pressed, offline = _pressed(faces)
    times = np.arange(round(touch.duration * TICKS) + 1) / TICKS
    approach, *_ = touch.at(times)
    depth = np.maximum(approach, 0.0)
    ratio = pressed.force / halfspace.DEPTHS**1.5
    force = depth**1.5 * np.interp(depth, halfspace.DEPTHS, ratio)
    area = depth * np.interp(depth, halfspace.DEPTHS, pressed.area / halfspace.DEPTHS)
    values = {"force": force, "indentation": depth, "area": area, "energy": truth.worked(force, depth)}
    return Outcome(times, values, [], pressed.seconds, None, offline)
