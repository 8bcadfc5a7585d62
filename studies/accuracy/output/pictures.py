"""Charts of error over step time: one per test case, and one of bodies on the test cases on tissue."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.methods import standard
from palpate.studies.accuracy.output.pareto import ParetoPoint, best, front, percent, point
from palpate.studies.accuracy.score import CHARGED, CHARGED_STEP
from palpate.views.pictures.style import FAINT, INK, figure

COLOURS = ("#1f5f8b", "#d97706", "#a4243b", "#4c8c4a", "#6d4c9f", "#8c564b", "#c2659b", "#5f6b73", "#9a8f1f", "#2aa1a8",
           "#2b2b33", "#b0522a", "#7f9c3c", "#46629e")  # fmt: skip
MARKS = "osD^vPX<>hdp8H"
LOOPS = ((1e-3, "a loop at 1 kHz"), (1e-4, "at 10 kHz"))
GOOD = 0.02  # [1] The goal for the force error, drawn as a line
LEAST = 1e-4  # [1] Smaller errors are drawn here


def touch_picture(cells: Sequence[Cell], path: Path) -> None:
    """Draw the chart of one test case."""
    own = [c for c in cells if c.status != "refused"]
    refused = [c for c in cells if c.status == "refused"]
    drawn, axes = _empty(f"{cells[0].touch}: {TOUCHES[cells[0].touch].title}")
    look = _looks(cells)
    points = [point(c) for c in own]
    on_front = front(points)
    # A line from p50 to p99 and a mark per setting; open marks are at the uncertainty of the reference.
    for method in dict.fromkeys(c.method for c in own):
        mine = [k for k, c in enumerate(own) if c.method == method]
        colour, mark = look[method]
        for k in mine:
            cell, (x, y) = own[k], points[k]
            axes.plot([cell.p50, cell.p99], [y, y], color=colour, alpha=0.35, linewidth=1)
            failed = cell.status == "failed"
            axes.plot(x, y, "x" if failed else mark, color=colour, markersize=7 if k in on_front else 5,
                      markerfacecolor="white" if cell.at_reference() else colour)  # fmt: skip
        axes.plot([], [], mark, color=colour, label=own[mine[0]].title)
    if on_front:
        _front(axes, [points[k] for k in on_front], "Pareto front")
    # The band of the reference, the unsupported methods, and names on the front.
    bands = [c.errors["force"]["band"] for c in own if c.status == "ok"]
    charged = [(CHARGED_STEP, CHARGED)] if refused else []
    _finish(axes, "rms error of the force over its peak", points + charged)
    if bands and max(bands) > axes.get_ylim()[0]:
        axes.axhspan(axes.get_ylim()[0], max(bands), color=FAINT, alpha=0.35, linewidth=0, label="at the reference")
    if refused:
        axes.plot(CHARGED_STEP, CHARGED, "x", color=INK, label="unsupported methods, drawn at 100 %")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    _label(axes, [(*points[k], f"{own[k].title}, {own[k].fidelity}", look[own[k].method][0]) for k in on_front])
    _save(drawn, path)


def overview(summary: Sequence[ParetoPoint], cells: Sequence[Cell], path: Path) -> None:
    """Draw median error over median step time of bodies on tissue, with a line to the worst test case.

    Open marks: settings that compute fewer test cases than others.
    """
    drawn, axes = _empty("Bodies on tissue: force error over step time")
    look = _looks(cells)
    points = [(s.p99, max(s.error, LEAST)) for s in summary]
    most = max(s.computed for s in summary)
    for method in dict.fromkeys(s.method for s in summary):
        colour, mark = look[method]
        mine = [k for k, s in enumerate(summary) if s.method == method]
        for k in mine:
            (x, y), one = points[k], summary[k]
            axes.plot([one.p50, x], [y, y], color=colour, alpha=0.35, linewidth=1)
            axes.plot([x, x], [y, max(one.worst, LEAST)], color=colour, alpha=0.35, linewidth=1)
            axes.plot(x, max(one.worst, LEAST), "_", color=colour, markersize=7)
        first = summary[mine[0]]
        axes.plot(*np.array([points[k] for k in mine]).T, mark, color=colour, markersize=6, alpha=0.8, linestyle="none",
                  markerfacecolor=colour if first.computed == most else "white",
                  label=f"{first.title}: {first.computed} of {first.computed + first.charged}")  # fmt: skip
    _front(axes, [points[k] for k in best(summary)], f"Pareto front of those with {most}")
    axes.axhline(GOOD, color=FAINT, linewidth=1, linestyle="--", zorder=0)
    axes.annotate(f"{100 * GOOD:g} %", (0.995, GOOD), xycoords=("axes fraction", "data"), xytext=(0, 3), fontsize=8,
                  color="#77777f", textcoords="offset points", ha="right")  # fmt: skip
    below = f"; smaller errors at {percent(LEAST)}" if any(s.error < LEAST for s in summary) else ""
    ends = [(time, max(s.worst, LEAST)) for s in summary for time in (s.p50, s.p99)]
    _finish(axes, f"force error, RMS over the peak:\nmedian, and worst test case{below}", points + ends)
    axes.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False,
                title="test cases computed")  # fmt: skip
    _save(drawn, path)


def _looks(cells: Sequence[Cell]) -> dict[str, tuple[str, str]]:
    """Colour and mark of each method, the same in all pictures of a run."""
    order = dict.fromkeys([*(known.name for known in standard()), *sorted(c.method for c in cells)])
    return {m: (COLOURS[k % len(COLOURS)], MARKS[k % len(MARKS)]) for k, m in enumerate(order)}


def _empty(title: str) -> tuple[Figure, Axes]:
    drawn = figure(10.5, 6.2, title)
    axes = drawn.subplots()
    axes.set(xscale="log", yscale="log")
    return drawn, axes


def _finish(axes: Axes, label: str, points: Sequence[tuple[float, float]]) -> None:
    times, errors = np.array(points).T
    axes.set_xlim(min(times.min() / 1.5, 5e-6), max(times.max() * 3, 3e-3))
    axes.set_ylim(errors.min() / 3, max(2.0, errors.max() * 1.6))
    for period, name in LOOPS:
        axes.axvline(period, color=FAINT, linewidth=1, zorder=0)
        axes.annotate(name, (period, 0.01), xycoords=("data", "axes fraction"), xytext=(3, 0), color="#77777f",
                      textcoords="offset points", fontsize=8)  # fmt: skip
    axes.set_xlabel("processor time of a compiled step [s]: the point is p99, its line begins at p50")
    axes.set_ylabel(label)


def _front(axes: Axes, points: Sequence[tuple[float, float]], label: str) -> None:
    axes.step(*np.array(points).T, where="post", color=INK, linewidth=1.2, linestyle=":", label=label, zorder=1)


def _label(axes: Axes, texts: Sequence[tuple[float, float, str, str]]) -> None:
    """Label the points (x, y, text, colour) of the front, alternately above and below."""
    for k, (x, y, text, colour) in enumerate(texts):
        axes.annotate(text, (x, y), xytext=(6, -12 if k % 2 else 6), textcoords="offset points", fontsize=7.5,
                      color=colour)  # fmt: skip


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120, bbox_inches="tight")
