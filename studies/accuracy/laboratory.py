"""Full finite elements as a method: too slow for a loop, and what the fast models are held against.

A load step of the static curve is the step that is priced; the touch over time follows from the curve.
"""

from dataclasses import replace

import numpy as np

from palpate.studies.accuracy import places, truth
from palpate.studies.accuracy.continuum import Block
from palpate.studies.accuracy.outcome import LOOKS, NEAR, Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.places import PLACES, cells_text
from palpate.studies.accuracy.touches import BenchCase

TICKS = 1000.0  # [Hz] At which the touch is told
CELLS = (1, 2, 3, 4)  # Across the radius
REFUSED = {
    "half-space": "a half-space has no border, and a closed form: Hertz's",
    "kidney": "the whole kidney takes minutes: python benchmarks/references.py",
    "plate": "the layered fingertip takes minutes: palpate fe fingertip",
}
"""Bodies that are not meshed here, and why."""


def methods() -> list[Method]:
    finer = tuple(Fidelity(cells_text(n), settings={"fe": {"cells": n}}, quick=n == 1) for n in CELLS)
    return [Method("full-FE", "full FE", _pressed, finer, lambda touch: REFUSED.get(touch.body, ""))]


def _pressed(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
    cells = int(str(fidelity.settings["fe"]["cells"]))
    base = PLACES[touch.place]
    assert isinstance(base, Block)
    curve = places.computed(replace(base, cells=cells))
    fine = np.arange(round(touch.duration * truth.RATE) + 1) / truth.RATE
    _, _, place, slip = touch.at(fine)
    force, depth, elastic = truth.in_time(touch, curve.force, curve.indentation)
    every = round(truth.RATE / TICKS)
    values = truth.derived(touch, slip, force, depth)
    dent = truth.Dent(curve.force, curve.x, curve.y, curve.shape)
    x, y = np.meshgrid(np.linspace(-NEAR, NEAR, 17), np.linspace(-NEAR, NEAR, 17))
    near = np.stack([x.ravel(), y.ravel()], axis=1)
    near = near[np.hypot(*near.T) < NEAR]
    shapes = [
        (float(fine[k]), near + (place[k], 0.0), dent(near + (base.place, 0.0), float(elastic[k])))
        for k in np.linspace(0, len(fine) - 1, LOOKS + 2).astype(int)[1:-1]
    ]
    told = {name: v[::every] for name, v in values.items()}
    return MethodOutcome(fine[::every], told, shapes, curve.seconds, None, 0.0)
