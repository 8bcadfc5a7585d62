"""Full finite elements as a method: too slow for a loop, and what the fast models are held against.

A load step of the static curve is the step that is priced; the touch over time follows from the curve.
"""

from dataclasses import replace

import numpy as np

from palpate.studies.accuracy import UnsupportedError, places, truth
from palpate.studies.accuracy.outcome import LOOKS, NEAR, Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.places import PLACES, cells_text, on_path
from palpate.studies.accuracy.touches import BenchCase

TICKS = 1000.0
"""[Hz] At which the touch is told."""
CELLS = (1, 2, 3, 4)
"""Across the radius."""
REFUSED = {
    "plate": "the layered fingertip takes minutes: palpate fe fingertip",
    "half-space": "a half-space has no border, and a closed form: Hertz's",
}
"""Bodies that are not meshed here, and why."""


def methods() -> list[Method]:
    """Full FE."""
    finer = tuple(Fidelity(cells_text(n), "mesh", settings={"fe": {"cells": n}}, quick=n == 1) for n in CELLS)
    return [Method("full-FE", "full FE", _pressed, finer, lambda touch: REFUSED.get(touch.body, ""))]


def _pressed(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
    cells = int(str(fidelity.settings["fe"]["cells"]))
    if not set(on_path(touch.place)) <= set(PLACES):
        raise UnsupportedError(f"place {touch.place!r} is not known")
    blocks = [replace(PLACES[name], cells=cells) for name in on_path(touch.place)]
    curves = [places.computed(block) for block in blocks]
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
