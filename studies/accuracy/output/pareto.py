"""Which points no other point beats in both error and time, an overview of all touches, and what to take."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.touches import TISSUE, TOUCHES

GAIN = 0.98  # [1] Share of the error of the cheaper ones below which a point counts as more accurate than they
LOOP = 1e-3  # [s] Period of a haptic loop


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Which (time, error) are on the Pareto front, by growing time."""
    beaten_by_none, best = [], np.inf
    for k in sorted(range(len(points)), key=lambda k: (points[k][0], points[k][1], k)):
        if points[k][1] < GAIN * best:
            beaten_by_none.append(k)
            best = points[k][1]
    return beaten_by_none


def point(cell: Cell) -> tuple[float, float]:
    """Time [s] of a step, p99, and rms error [1] of the force; an error below the reference's own stands at that."""
    own = cell.errors["force"]
    return cell.p99, max(own["rms"], own["band"], 1e-12)


@dataclass(frozen=True)
class ParetoPoint:
    """A method at one setting over the touches that it computed.

    error     [1] median of the rms errors of the force;  worst [1] the greatest of them, on the touch `hardest`
    p50, p99  [s] of a step, median
    computed  how many touches;  charged  how many it could not do or broke down on, which are in no error
    """

    method: str
    title: str
    fidelity: str
    error: float
    worst: float
    hardest: str
    p50: float
    p99: float
    computed: int
    charged: int


def duration(seconds: float) -> str:
    for unit, scale in (("µs", 1e6), ("ms", 1e3)):
        if seconds * scale < 1000:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds:.3g} s"


def summaries(cells: Sequence[Cell]) -> list[ParetoPoint]:
    """One for each method and setting that computed a touch, those of a method together, in the order in which they
    come."""
    touches = {c.touch for c in cells}
    groups: dict[str, dict[str, list[Cell]]] = {}
    for cell in cells:
        if cell.status == "ok":
            groups.setdefault(cell.method, {}).setdefault(cell.fidelity, []).append(cell)
    told = []
    for method, settings in groups.items():
        for fidelity, good in settings.items():
            errors = [c.errors["force"]["rms"] for c in good]
            worst = int(np.argmax(errors))
            p50, p99 = np.median([(c.p50, c.p99) for c in good], axis=0)
            told.append(
                ParetoPoint(
                    method, good[0].title, fidelity, float(np.median(errors)), errors[worst], good[worst].touch,
                    float(p50), float(p99), len(good), len(touches) - len(good),
                )
            )  # fmt: skip
    return told


def of_bodies(cells: Sequence[Cell]) -> list[Cell]:
    """Cells of bodies on the test cases that a tissue has to be able to do; all cells where there is none of these."""
    return [c for c in cells if not c.law and TOUCHES[c.touch].body in TISSUE] or list(cells)


def of_laws(cells: Sequence[Cell]) -> list[Cell]:
    """Cells of laws that computed their test case."""
    return [c for c in cells if c.law and c.status == "ok"]


def elsewhere(cells: Sequence[Cell]) -> list[str]:
    """Force errors of bodies on the other test cases, a sentence each; the first setting of a method stands for it."""
    lines = []
    for touch in dict.fromkeys(c.touch for c in cells if TOUCHES[c.touch].body not in TISSUE):
        own = {c.title: c for c in reversed(cells) if c.touch == touch and c.status == "ok" and not c.law}
        errors = ", ".join(f"{title} {percent(c.errors['force']['rms'])}" for title, c in reversed(own.items()))
        if errors:
            lines.append(
                f"Not in the picture and the table: {TOUCHES[touch].title} (`{touch}`). Force error: {errors}."
            )
    return lines


def best(told: Sequence[ParetoPoint]) -> list[int]:
    """The Pareto front of those that compute as many touches as any does: the median of few is not held against one of
    many."""
    most = max((s.computed for s in told), default=0)
    able = [k for k, s in enumerate(told) if s.computed == most]
    return [able[k] for k in front([(told[k].p99, told[k].error) for k in able])]


def advice(told: Sequence[ParetoPoint]) -> str:
    """One sentence or two: what to take for these touches.

    The one with the least error on its worst touch, of those that compute as many touches as any does and whose step
    keeps a loop at 1 kHz in the median, which other programs hardly change. Where another has a lower median, that one
    and the touch that it is wrong for."""
    most = max((s.computed for s in told), default=0)
    able = [s for s in told if s.computed == most]
    if not able:
        return "Nothing computed any of these touches."
    quick = [s for s in able if s.p50 < LOOP]
    take = min(quick or able, key=lambda s: (s.worst, s.p99))
    finer = min(quick or able, key=lambda s: (s.error, s.p99))
    many = f"{take.computed} touches" if take.computed > 1 else f"the touch {take.hardest}"
    worst = f", {percent(take.worst)} at worst, {take.hardest}" if take.computed > 1 else ""
    slow = "" if quick else " Nothing here keeps a loop at 1 kHz."
    if finer.error < take.error:
        slow = (
            f" {finer.title}, {finer.fidelity}, is off by {percent(finer.error)} in the median, but by "
            f"{percent(finer.worst)} on {finer.hardest}: take it for other touches.{slow}"
        )
    return (
        f"For {many} take {take.title}, {take.fidelity}: force off by {percent(take.error)} (RMS over the peak, median"
        f"{worst}), p50 {duration(take.p50)}, p99 {duration(take.p99)}.{slow}"
    )


def unable(cells: Sequence[Cell]) -> list[str]:
    """Titles of the methods that computed none of the touches."""
    able = {c.method for c in cells if c.status == "ok"}
    return list(dict.fromkeys(c.title for c in cells if c.method not in able))


def percent(value: float) -> str:
    if value < 1e-5:
        return "< 0.001 %"
    return f"{100 * value:.2g} %" if value < 1.0 else f"{100 * value:.0f} %"
