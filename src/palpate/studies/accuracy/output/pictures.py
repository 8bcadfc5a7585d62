"""The chart of error over step time: bodies on the test cases on tissue."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.methods import standard
from palpate.studies.accuracy.output.pareto import ParetoPoint, best, percent
from palpate.views.pictures.style import FAINT, INK, figure, look

COLOURS = ("#1f5f8b", "#d97706", "#a4243b", "#4c8c4a", "#6d4c9f", "#8c564b", "#c2659b", "#5f6b73", "#9a8f1f", "#2aa1a8",
           "#2b2b33", "#b0522a", "#7f9c3c", "#46629e")  # fmt: skip
MARKS = "osD^vPX<>hdp8H"
LOOPS = ((1e-3, "a loop at 1 kHz"), (1e-4, "at 10 kHz"))
GOOD = 0.02  # [1] The goal for the force error, drawn as a line
LEAST = 1e-4  # [1] Smaller errors are drawn at this value


@look()
def overview(summary: Sequence[ParetoPoint], cells: Sequence[Cell], path: Path) -> None:
    """Draw median error over median step time of bodies on tissue, with a line to the worst test case.

    Open marks: settings that compute fewer test cases than others.
    """
    drawn = figure(10.5, 6.2, "Bodies on tissue: force error over step time")
    axes = drawn.subplots()
    axes.set(xscale="log", yscale="log")
    order = dict.fromkeys([*(known.name for known in standard()), *sorted(c.method for c in cells)])
    looks = {m: (COLOURS[k % len(COLOURS)], MARKS[k % len(MARKS)]) for k, m in enumerate(order)}
    # Points of each method, with lines to p50 and to the worst test case.
    points = [(s.p99, max(s.error, LEAST)) for s in summary]
    most = max(s.computed for s in summary)
    for method in dict.fromkeys(s.method for s in summary):
        colour, mark = looks[method]
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
    # Pareto front, the goal for the error, and the periods of loops.
    axes.step(*np.array([points[k] for k in best(summary)]).T, where="post", color=INK, linewidth=1.2, linestyle=":",
              label=f"Pareto front of those with {most}", zorder=1)  # fmt: skip
    axes.axhline(GOOD, color=FAINT, linewidth=1, linestyle="--", zorder=0)
    axes.annotate(f"{100 * GOOD:g} %", (0.995, GOOD), xycoords=("axes fraction", "data"), xytext=(0, 3), fontsize=8,
                  color="#77777f", textcoords="offset points", ha="right")  # fmt: skip
    for period, name in LOOPS:
        axes.axvline(period, color=FAINT, linewidth=1, zorder=0)
        axes.annotate(name, (period, 0.01), xycoords=("data", "axes fraction"), xytext=(3, 0), color="#77777f",
                      textcoords="offset points", fontsize=8)  # fmt: skip
    # Axes and legend.
    ends = [(time, max(s.worst, LEAST)) for s in summary for time in (s.p50, s.p99)]
    times, errors = np.array(points + ends).T
    axes.set_xlim(min(times.min() / 1.5, 5e-6), max(times.max() * 3, 3e-3))
    axes.set_ylim(errors.min() / 3, max(2.0, errors.max() * 1.6))
    axes.set_xlabel("processor time of a compiled step [s]: the point is p99, its line begins at p50")
    below = f"; smaller errors at {percent(LEAST)}" if any(s.error < LEAST for s in summary) else ""
    axes.set_ylabel(f"force error, RMS over the peak:\nmedian, and worst test case{below}")
    axes.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False,
                title="test cases computed")  # fmt: skip
    _save(drawn, path)


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120, bbox_inches="tight")
