"""Which points no other point beats in both error and time, and an overview of all touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.score import CHARGED, CHARGED_STEP

GAIN = 0.98
"""[1] Share of the error of the cheaper ones below which a point counts as more accurate than they."""


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Which (time, error) are on the Pareto front, by growing time."""
    beaten_by_none, best = [], np.inf
    for k in sorted(range(len(points)), key=lambda k: (points[k][0], points[k][1], k)):
        if points[k][1] < GAIN * best:
            beaten_by_none.append(k)
            best = points[k][1]
    return beaten_by_none


def point(cell: Cell, quantity: str = "force") -> tuple[float, float]:
    """Time [s] of a step, p99, and rms error [1] of a cell, that of a quantity it does not tell charged in full. An
    error below the reference's own stands at that."""
    own = cell.errors.get(quantity)
    if own is None:
        return cell.p99, CHARGED
    return cell.p99, max(own["rms"], own["band"], 1e-12)


@dataclass(frozen=True)
class Summary:
    """A method at one setting over all touches.

    error     [1] mean of the rms errors of the force; what it cannot do is charged, and nothing is charged more
    p50, p99  [s] of a step, median over the touches
    computed  how many of the `touches` it computed
    """

    method: str
    title: str
    fidelity: str
    error: float
    p50: float
    p99: float
    computed: int
    touches: int

    def cost(self, seconds: float) -> str:
        """A time of it in words."""
        return duration(seconds) if self.computed else "charged"


def duration(seconds: float) -> str:
    """In the unit that fits."""
    for unit, scale in (("µs", 1e6), ("ms", 1e3)):
        if seconds * scale < 1000:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds:.3g} s"


def summaries(cells: Sequence[Cell]) -> list[Summary]:
    """One for each method and setting, those of a method together, in the order in which they come."""
    touches = list(dict.fromkeys(c.touch for c in cells))
    lost = {(c.method, c.touch) for c in cells if c.status == "refused"}
    groups: dict[tuple[str, str], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.method, cell.fidelity), []).append(cell)
    told = []
    for (method, fidelity), own in groups.items():
        good = [c for c in own if c.status == "ok"]
        if not good and any(c.method == method and c.status == "ok" for c in cells) and own[0].status == "refused":
            continue  # a setting that stands for a refused touch only
        missing = len(touches) - len({c.touch for c in own if c.status != "refused"})
        assert missing >= sum((method, t) in lost for t in touches)
        errors = [min(c.errors["force"]["rms"], CHARGED) for c in own if c.status != "refused"] + [CHARGED] * missing
        times = [(c.p50, c.p99) for c in good] or [(CHARGED_STEP, CHARGED_STEP)]
        p50, p99 = np.median(times, axis=0)
        told.append(
            Summary(
                method, own[0].title, fidelity, float(np.mean(errors)), float(p50), float(p99), len(good), len(touches)
            )
        )
    methods = list(dict.fromkeys(method for method, _ in groups))
    return sorted(told, key=lambda s: methods.index(s.method))
