"""Error of a tabulated law: its mesh and its interpolation, compared with a finer mesh."""

import math
from dataclasses import replace

import numpy as np

from palpate.models.fit.tissue.estimate import Estimate, Problem
from palpate.models.fit.tissue.tabulated import FINE, REFERENCE

CHECKED = 8  # Depths at which the finer mesh checks a table


def include_mesh_error(problem: Problem, best: Estimate, steady: dict[str, tuple[float, float]]) -> str:
    """Widen the intervals of a tabulated law, and those in `steady`, by the error of its mesh and interpolation.

    Its force is multiplied by the ratio of the finer mesh to the table at the fitted shape, over the depth, and fitted
    again: each interval then includes itself moved by the change of its parameter. Returns a note.
    """
    law, start = problem.law, best.at
    assert law.finer is not None  # of a tabulated law
    deepest = max(float(p.depth.max()) - t for p, t in zip(problem.presses, best.touches, strict=True))
    depths = min(deepest, law.reach) * np.linspace(0.0, 1.0, CHECKED + 1)[1:] ** 1.5
    values = {**best.values, "young": REFERENCE}
    ratio = law.finer({k: v for k, v in values.items() if k != "young"}, depths) / law.force(values, depths)
    known = np.isfinite(ratio)
    if not known.any():
        return (
            "the solver found no equilibrium on the finer mesh, so the intervals do not include the error of the mesh"
        )
    at, factor = depths[known], ratio[known]
    fine = replace(law, force=lambda v, s: law.force(v, s) * np.interp(s, at, factor))
    moved, _ = problem.with_changes(law=fine).solve(start)
    for i, p in enumerate(problem.parameters):
        shift, now = float(moved[i] - start[i]), best.intervals[p.name]
        for each in [now] if not best.withheld else []:
            ends = [p.to_search(v) + part for v in (each.low, each.high) for part in (0.0, shift)]
            each.low, each.high = (min(max(p.value(v), p.low), p.high) for v in (min(ends), max(ends)))
        if p.name in steady:
            ends = [p.to_search(v) + part for v in steady[p.name] for part in (0.0, shift)]
            steady[p.name] = (max(p.value(min(ends)), p.low), min(p.value(max(ends)), p.high))
    wrong = 100.0 * float(np.abs(factor - 1.0).max())
    change = 100.0 * math.expm1(float(moved[0] - start[0]))
    return (
        f"mesh and table: error of the force of at most {wrong:.1f} % compared with {FINE} elements across; "
        f"{problem.parameters[0].name} changes by {change:+.2g} % with it, and the intervals include this"
    )
