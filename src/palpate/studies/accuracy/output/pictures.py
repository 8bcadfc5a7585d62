"""The chart of error over cost: a line per method over its settings, the budgets of a loop, and random touches."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.methods import standard
from palpate.studies.accuracy.output.pareto import ParetoPoint, best_within, of_bodies, percent
from palpate.views.pictures.style import FAINT, INK, REGION_A, figure, look, save

COLOURS = ("#1f5f8b", "#d97706", "#a4243b", "#4c8c4a", "#6d4c9f", "#8c564b", "#c2659b", "#5f6b73", "#9a8f1f", "#2aa1a8",
           "#2b2b33", "#b0522a", "#7f9c3c", "#46629e")  # fmt: skip
MARKS = "osD^vPX<>hdp8H"
STYLES = {
    "# vertices": ("--", "of the mesh"),
    "condensed to # vertices": (":", "of the reduced body"),
    "# Hz": ("-", ""),
}
"""Line and meaning of the numbers that a line joins; others, such as cells, are solid with labelled ends."""
OTHER_PATCH = "kernel of"  # Settings of a patch of another radius: another problem, not a price; in the table only
BUDGETS = (0.01, 0.1, 1.0)
"""[1] Processor time of a method per time of the touch: shares of one core. 1 is the limit of a loop in real time."""
BEST = "within"  # Start of the labels of stars
GOOD = 0.02  # [1] The goal for the force error, drawn as a line
LEAST = 1e-4  # [1] Smaller errors are drawn at this value
RANDOM = {
    "MassSpring": "MassSpring, one K",
    "MassSpring, map": "MassSpring, calibrated",
    "BeamBundle": "BeamBundle, calibrated",
}
"""Names of `benchmarks/every_place.py` and the titles of their methods; MassSpring with one K is in no other panel."""


@look()
def overview(
    summary: Sequence[ParetoPoint], cells: Sequence[Cell], path: Path, places: Mapping[str, Any] | None = None
) -> None:
    """Draw the median error of bodies on tissue over their cost: p99 of a step times the rate of the steps.

    A line joins the settings of a method that differ in one number (`STYLES`). Shading: the budgets of a loop. Stars:
    the most accurate setting within each, of those that compute the largest number of test cases; their lines lead to
    the worst test case.

    places  the JSON of `benchmarks/every_place.py`, for a second panel: the errors of single touches at random places
    """
    drawn = figure(15.0 if places else 11.0, 7.0, "Price of accuracy: bodies on tissue")
    axes, *aside = drawn.subplots(1, 2 if places else 1, width_ratios=(3, 1) if places else None, sharey=True,
                                  squeeze=False)[0]  # fmt: skip
    axes.set(xscale="log", yscale="log")
    order = dict.fromkeys([*(known.name for known in standard()), *sorted(c.method for c in cells)])
    looks = {m: (COLOURS[k % len(COLOURS)], MARKS[k % len(MARKS)]) for k, m in enumerate(order)}
    most = max(s.computed for s in summary)
    _draw_methods(axes, summary, looks, most)
    # Budgets with the best setting in each, the goal, and the band of the references.
    limits = (min(cost(s) for s in summary) / 2.5, max(max(cost(s) for s in summary) * 3, 3.0))
    _budgets(axes, summary, limits[0])
    for each in (axes, *aside):
        each.axhline(GOOD, color=FAINT, linewidth=1, linestyle="--", zorder=0)
    band = float(np.median([c.errors["force"]["band"] for c in of_bodies(cells) if c.status == "ok"] or [0.0]))
    low = min([max(s.error, LEAST) for s in summary] + [band or 1.0]) / 2.5
    if band:
        axes.axhspan(low, band, color=FAINT, alpha=0.25, linewidth=0, zorder=0,
                     label=f"below {percent(band)}: uncertainty of the reference")  # fmt: skip
    axes.set(xlim=limits, ylim=(low, max(1.0, 1.6 * max(s.worst for s in summary))))
    _label(axes, most, any(s.error < LEAST for s in summary))
    _explain(axes)
    for panel in aside:
        _random(panel, places or {}, {s.title: looks[s.method][0] for s in summary})
    _save(drawn, path)


def _draw_methods(axes: Axes, summary: Sequence[ParetoPoint], looks: Mapping[str, tuple[str, str]], most: int) -> None:
    """A line for each method and number that its settings vary; filled marks computed `most` test cases."""
    for method in dict.fromkeys(s.method for s in summary):
        mine = [s for s in summary if s.method == method and not s.fidelity.startswith(OTHER_PATCH)]
        for k, line in enumerate(lines_of(mine)):
            colour, mark = looks[method]
            kind = kind_of(line[0].fidelity)
            label = f"{mine[0].title}: {mine[0].computed} of {mine[0].computed + mine[0].charged}" if k == 0 else None
            points = np.array([(cost(s), max(s.error, LEAST)) for s in line])
            face = colour if line[0].computed == most else "white"
            axes.plot(*points.T, marker=mark, color=colour, markersize=5, linewidth=1.2, markerfacecolor=face,
                      linestyle=STYLES.get(kind, ("-", ""))[0], label=label)  # fmt: skip
            for at in {0, len(line) - 1} if len(line) > 1 and kind not in STYLES else ():
                axes.annotate(short(line[at].fidelity), points[at], (6, 4), textcoords="offset points", color=colour,
                              fontsize=8)  # fmt: skip
    for kind, (style, what) in STYLES.items():
        known = sorted({number_of(s.fidelity) for s in summary if kind_of(s.fidelity) == kind})
        if len(known) > 1:
            text = kind.rpartition("to ")[2].replace("#", f"{known[0]:g} to {known[-1]:g}")
            axes.plot([], [], color=FAINT, linestyle=style, label=f"{text} {what}".rstrip())


def _label(axes: Axes, most: int, cut: bool) -> None:
    """Scales and their labels; `cut`: smaller errors are drawn at `LEAST`."""
    axes.set_xlabel("cost [% of a core]: p99 of the processor time of a step, times the rate of the steps")
    below = f";\nsmaller errors at {percent(LEAST)}" if cut else ""
    axes.set_ylabel(f"force error, RMS over the peak: median of {most} test cases{below}")
    for scale in (axes.yaxis, axes.xaxis):
        scale.set_major_formatter(lambda value, _: f"{100 * value:.15g} %")
    kilo: Any = (lambda share: share / 1e3, lambda step: step * 1e3)
    top = axes.secondary_xaxis("top", functions=kilo)
    top.set_xlabel("the same as the time of a step at 1 kHz [s]")


def _explain(axes: Axes) -> None:
    """Legends: the methods, and the best setting of each budget."""
    marks, names = axes.get_legend_handles_labels()
    best = [k for k, name in enumerate(names) if name.startswith(BEST)]
    others = [k for k in range(len(names)) if k not in best]
    given: dict[str, Any] = {"fontsize": 8, "frameon": True, "framealpha": 0.9}
    above = axes.legend([marks[k] for k in others], [names[k] for k in others], loc="upper right",
                        title="method: test cases computed", **given)  # fmt: skip
    if best:
        axes.add_artist(above)
        axes.legend([marks[k] for k in best], [names[k] for k in best], loc="lower center", bbox_to_anchor=(0.62, 0.0),
                    title="most accurate setting", **given)  # fmt: skip


def cost(point: ParetoPoint) -> float:
    """p99 of a step times the rate [1]: the share of one core that the method takes in real time."""
    return point.p99 * point.rate


def lines_of(points: Sequence[ParetoPoint]) -> list[list[ParetoPoint]]:
    """The settings of one method that differ in one number, by this number; the longest line first. A setting at the
    default, without a number, is a line of one point."""
    families: dict[str, list[tuple[float, ParetoPoint]]] = {}
    for point in points:
        families.setdefault(kind_of(point.fidelity), []).append((number_of(point.fidelity), point))
    ordered = [[p for _, p in sorted(line, key=lambda one: one[0])] for line in families.values()]
    return sorted(ordered, key=lambda line: -len(line))


def kind_of(fidelity: str) -> str:
    """The setting without its number."""
    return re.sub(r"\d+(\.\d+)?|cells?", "#", fidelity)


def number_of(fidelity: str) -> float:
    """The number of the setting; 0: it has none."""
    found = re.search(r"\d+(\.\d+)?", fidelity)
    return float(found[0]) if found else 0.0


def short(fidelity: str) -> str:
    """The setting as a label in the chart."""
    text = re.sub(r"(\d+)000 Hz", r"\1 kHz", fidelity)
    for long, brief in (
        (" a radius", ""),
        ("condensed to ", ""),
        ("second order", "2nd order"),
        (" vertices", " vert."),
    ):
        text = text.replace(long, brief)
    return text


def _budgets(axes: Axes, summary: Sequence[ParetoPoint], left: float) -> None:
    for k, budget in enumerate(BUDGETS):
        axes.axvspan(left, budget, color=REGION_A, alpha=0.35, linewidth=0, zorder=0)
        text = f"{100 * budget:g} % of a core" + (": limit of real time" if k == len(BUDGETS) - 1 else "")
        axes.annotate(text, (budget, 0.01), xycoords=("data", "axes fraction"), xytext=(-3, 0), color="#55606b",
                      textcoords="offset points", fontsize=8, rotation=90, ha="right", va="bottom")  # fmt: skip
    found: dict[ParetoPoint, list[str]] = {}
    for budget in BUDGETS:
        if (one := best_within(summary, budget)) is not None:
            found.setdefault(one, []).append(f"{100 * budget:g} %")
    for one, budgets in found.items():
        x, y = cost(one), max(one.error, LEAST)
        axes.plot([x, x], [y, max(one.worst, LEAST)], color=INK, linewidth=0.8, alpha=0.6)
        axes.plot(x, max(one.worst, LEAST), "_", color=INK, markersize=8)
        axes.plot(x, y, "*", color="#ffd166", markeredgecolor=INK, markersize=14, linestyle="none", zorder=6,
                  label=f"{BEST} {' and '.join(budgets)}: {one.title},\n{one.fidelity}: {percent(one.error)}, "
                  f"{percent(one.worst)} in {one.hardest}")  # fmt: skip


def _random(axes: Axes, places: Mapping[str, Any], colours: Mapping[str, str]) -> None:
    """Error of single touches at random places: all touches, median, and 5 to 95 %."""
    count = 0
    for k, (name, rows) in enumerate(places["errors"].items()):
        errors = np.sort([row["rms"] for row in rows])
        count = len(errors)
        colour = colours.get(RANDOM.get(name, name), "#5f6b73")
        spread = np.modf(np.arange(count) * 0.618034)[0] - 0.5  # evenly over the width, without random numbers
        axes.plot(k + 0.55 * spread, errors, ".", color=colour, markersize=3, alpha=0.5)
        low, middle, high = np.percentile(errors, (5, 50, 95))
        axes.plot([k, k], [low, high], color=INK, linewidth=1.4)
        axes.plot([k - 0.3, k + 0.3], [middle, middle], color=INK, linewidth=1.8)
        axes.annotate(percent(float(middle)), (k + 0.32, middle), fontsize=8, va="center")
    names = [RANDOM.get(name, name).replace(", ", "\n") for name in places["errors"]]
    axes.set_xticks(range(len(names)), names, fontsize=9)
    axes.set_xlim(-0.6, len(names) - 0.2)
    axes.tick_params(labelleft=True)
    axes.set_title(f"{count} random touches of the kidney,\nagainst {places['reference'].rpartition('.')[2]}: "
                   "median, 5 to 95 %", fontsize=10)  # fmt: skip


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path, dpi=120)
