"""Pareto front over error and time, an overview of all test cases, and a recommendation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.studies.accuracy.cases import TISSUE, TOUCHES
from palpate.studies.accuracy.cells import Cell

GAIN = 0.98  # [1] A point counts as more accurate if its error is below this share of that of all faster points
LOOP = 1e-3  # [s] Period of a haptic loop


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (time, error) on the Pareto front, by increasing time."""
    found, best = [], np.inf
    for k in sorted(range(len(points)), key=lambda k: (points[k][0], points[k][1], k)):
        if points[k][1] < GAIN * best:
            found.append(k)
            best = points[k][1]
    return found


def point(cell: Cell) -> tuple[float, float]:
    """p99 [s] of the step time and RMS error [1] of the force, at least the uncertainty of the reference."""
    error = cell.errors["force"]
    return cell.p99, max(error["rms"], error["band"], 1e-12)


@dataclass(frozen=True)
class ParetoPoint:
    """A method at one setting over the test cases that it computed.

    error     [1] median of the RMS force errors;  worst [1] the largest of them, on the test case `hardest`
    p50, p99  [s] median step time;  rate [Hz] of the steps
    computed  number of test cases;  charged: number of unsupported or failed ones, excluded from errors and times
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
    rate: float = 1000.0


def duration(seconds: float) -> str:
    for unit, scale in (("µs", 1e6), ("ms", 1e3)):
        if seconds * scale < 1000:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds:.3g} s"


def summaries(cells: Sequence[Cell]) -> list[ParetoPoint]:
    """One point per method and setting that computed a test case, grouped by method."""
    touches = {c.touch for c in cells}
    groups: dict[str, dict[str, list[Cell]]] = {}
    for cell in cells:
        if cell.status == "ok":
            groups.setdefault(cell.method, {}).setdefault(cell.fidelity, []).append(cell)
    found = []
    for method, settings in groups.items():
        for fidelity, good in settings.items():
            errors = [c.errors["force"]["rms"] for c in good]
            worst = int(np.argmax(errors))
            p50, p99 = np.median([(c.p50, c.p99) for c in good], axis=0)
            found.append(ParetoPoint(
                method, good[0].title, fidelity, float(np.median(errors)), errors[worst], good[worst].touch,
                float(p50), float(p99), len(good), len(touches) - len(good), good[0].rate,
            ))  # fmt: skip
    return found


def of_bodies(cells: Sequence[Cell]) -> list[Cell]:
    """Cells of bodies on the test cases on tissue; all cells if no body computed one."""
    return [c for c in cells if not c.law and TOUCHES[c.touch].body in TISSUE] or list(cells)


def of_laws(cells: Sequence[Cell]) -> list[Cell]:
    """Cells of contact laws that computed their test case."""
    return [c for c in cells if c.law and c.status == "ok"]


def elsewhere(cells: Sequence[Cell]) -> list[str]:
    """A sentence per other test case with the force errors of bodies, each at the first setting of its method."""
    lines = []
    for touch in dict.fromkeys(c.touch for c in cells if TOUCHES[c.touch].body not in TISSUE):
        first = {c.title: c for c in reversed(cells) if c.touch == touch and c.status == "ok" and not c.law}
        errors = ", ".join(f"{title} {percent(c.errors['force']['rms'])}" for title, c in reversed(first.items()))
        if errors:
            lines.append(
                f"Not in the picture and the table: {TOUCHES[touch].title} (`{touch}`). Force error: {errors}."
            )
    return lines


def best(points: Sequence[ParetoPoint]) -> list[int]:
    """The Pareto front of the points with the largest number of test cases, whose medians are comparable."""
    most = max((s.computed for s in points), default=0)
    able = [k for k, s in enumerate(points) if s.computed == most]
    return [able[k] for k in front([(points[k].p99, points[k].error) for k in able])]


def best_within(points: Sequence[ParetoPoint], share: float) -> ParetoPoint | None:
    """Of the settings that compute the largest number of test cases, and whose p99 times rate is at most this share [1]
    of a core, the one with the smallest error on its worst test case; None without any setting."""
    most = max((s.computed for s in points), default=0)
    able = [s for s in points if s.computed == most and s.p99 * s.rate <= share]
    return min(able, key=lambda s: (s.worst, s.error, s.p99), default=None)


def advice(points: Sequence[ParetoPoint]) -> str:
    """The recommended setting for these test cases, in one or two sentences.

    Of the settings with the largest number of test cases and a median step below 1 ms, the one with the smallest error
    on its worst test case. If another has a lower median error, it is named with the test case on which it fails.
    """
    most = max((s.computed for s in points), default=0)
    able = [s for s in points if s.computed == most]
    if not able:
        return "No method computed any of these touches."
    quick = [s for s in able if s.p50 < LOOP]
    take = min(quick or able, key=lambda s: (s.worst, s.p99))
    finer = min(quick or able, key=lambda s: (s.error, s.p99))
    many = f"{take.computed} touches" if take.computed > 1 else f"the touch {take.hardest}"
    worst = f", {percent(take.worst)} at worst, {take.hardest}" if take.computed > 1 else ""
    slow = "" if quick else " No method is fast enough for a loop at 1 kHz."
    if finer.error < take.error:
        slow = (
            f" {finer.title}, {finer.fidelity}, has a median error of {percent(finer.error)}, but "
            f"{percent(finer.worst)} on {finer.hardest}: use it for other touches.{slow}"
        )
    return (
        f"For {many} use {take.title}, {take.fidelity}: force error {percent(take.error)} (RMS over the peak, median"
        f"{worst}), p50 {duration(take.p50)}, p99 {duration(take.p99)}.{slow}"
    )


def unable(cells: Sequence[Cell]) -> list[str]:
    """Titles of the methods that computed none of the test cases."""
    able = {c.method for c in cells if c.status == "ok"}
    return list(dict.fromkeys(c.title for c in cells if c.method not in able))


def percent(value: float) -> str:
    if value < 1e-5:
        return "< 0.001 %"
    return f"{100 * value:.2g} %" if value < 1.0 else f"{100 * value:.0f} %"
