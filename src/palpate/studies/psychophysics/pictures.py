"""Pictures of an analysis: shares of answers over the level with the fitted function, or magnitudes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.studies.psychophysics.analysis import ALL, Outcome
from palpate.studies.psychophysics.functions import proportion
from palpate.views.pictures.plot import PREFIXES
from palpate.views.pictures.style import FINGER, INK, TISSUE, figure, log_ticks, look

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROW = 3  # panels
MOST = 24
WIDE = 8.0
NAMES = {"correct": "share correct", "yes": "share of yes", "judged greater": "comparison judged greater"}


def draw(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Draw one picture per task, with one panel per participant and block."""
    files = []
    for task in dict.fromkeys(one.task for one in outcomes):
        shown = [one for one in outcomes if one.task == task and one.participant != ALL][:MOST]
        columns, rows = min(len(shown), ROW), math.ceil(len(shown) / ROW)
        with look():
            fig = figure(max(4.0 * columns, 5.0), 3.4 * rows + 0.5, task)
            for number, one in enumerate(shown, 1):
                axes = fig.add_subplot(rows, columns, number)
                (_magnitude if one.of == "magnitude" else _function)(axes, one)
                axes.set_title(f"{one.participant}, {one.block}: {one.trials} trials", fontsize=11)
            files.append(folder / "derivatives" / "palpate" / f"task-{task}_psychometric.png")
            fig.savefig(files[-1])
    return files


def _function(axes: Axes, one: Outcome) -> None:
    fitted = one.fitted
    assert fitted is not None
    factor, unit = PREFIXES.get(one.unit, (1.0, one.unit))
    x, turned = np.array(one.levels), one.sign * factor
    ratio = x.min() > 0.0 and x.max() > WIDE * x.min()  # the steps were ratios
    room = 1.3 if ratio else 0.08 * (float(np.ptp(x)) or abs(float(x.max())))
    if ratio:
        line = np.geomspace(x.min() / room, x.max() * room, 400)
        log_ticks(axes)
    else:
        line = np.linspace(x.min() - room, x.max() + room, 400)
    share = proportion(fitted.function, line, fitted.threshold.value, fitted.spread.value, fitted.guess, fitted.lapse)
    axes.plot(turned * line, share, color=INK, zorder=2)
    sizes = 20.0 + 130.0 * np.array(one.counts) / max(one.counts)
    axes.scatter(turned * x, one.shares, s=sizes, color=TISSUE, edgecolor="white", zorder=3)
    a = fitted.threshold
    ends = np.clip(sorted((turned * a.low, turned * a.high)), *sorted((turned * line[0], turned * line[-1])))
    at = float(proportion(fitted.function, a.value, a.value, fitted.spread.value, fitted.guess, fitted.lapse))
    axes.plot(ends, [at, at], color=FINGER, linewidth=3.0, zorder=4, solid_capstyle="butt")
    axes.plot([turned * a.value], [at], marker="|", markersize=12, color=FINGER, zorder=4)
    distance = one.reference is not None and one.of != "judged greater"
    axes.set_xlabel(f"{one.path} [{unit}]{', from the reference' * distance}", fontsize=10)
    axes.set_ylabel(NAMES[one.of])
    axes.set_ylim(-0.03, 1.03)


def _magnitude(axes: Axes, one: Outcome) -> None:
    level, mean, n = np.array(one.levels), np.array(one.shares), one.numbers["exponent"].value
    factor, unit = PREFIXES.get(one.unit, (1.0, one.unit))
    axes.loglog(factor * level, mean, "o", color=TISSUE)
    if math.isfinite(n):
        weights = np.array(one.counts)
        middle = np.average(np.log(mean) - n * np.log(level), weights=weights)
        axes.loglog(factor * level, np.exp(middle) * level**n, color=INK)
    axes.set_xlabel(f"{one.path} [{unit}]")
    axes.set_ylabel("magnitude, geometric mean")
