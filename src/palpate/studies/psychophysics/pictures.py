"""Pictures of an analysis: shares of answers over the level with the fitted function, or magnitudes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from palpate.studies.psychophysics.analysis import ALL, Outcome
from palpate.views.pictures.style import FINGER, INK, TISSUE, figure, log_ticks, look, save
from palpate.views.plot import PREFIXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROW = 3  # panels
MOST = 24
WIDE = 8.0
GROUPS = 10  # of neighbouring levels
NAMES = {"correct": "share correct", "yes": "share of yes", "judged greater": "comparison judged greater"}


def draw_answers(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Draw one picture per task, with one panel per participant and block."""
    files = []
    for task in dict.fromkeys(one.task for one in outcomes):
        shown = [one for one in outcomes if one.task == task and one.participant != ALL][:MOST]
        columns, rows = min(len(shown), ROW), math.ceil(len(shown) / ROW)
        with look():
            width = max(4.0 * columns, 5.5)
            fig = figure(width, 3.6 * rows + 0.9, fill(shown[0].question or task, int(8.0 * width)))
            for number, one in enumerate(shown, 1):
                axes = fig.add_subplot(rows, columns, number)
                (_magnitude if one.of == "magnitude" else _function)(axes, one)
                axes.set_title(f"{one.participant}, {one.block}: {one.trials} trials", fontsize=11)
            files.append(folder / "derivatives" / "palpate" / f"task-{task}_psychometric.png")
            save(fig, files[-1])
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
    share, low, high = fitted.curve(line)
    axes.fill_between(turned * line, low, high, color=INK, alpha=0.12, linewidth=0.0, zorder=1)
    axes.plot(turned * line, share, color=INK, zorder=2)
    place, shares, counts = pool_levels(x, np.array(one.shares), np.array(one.counts), ratio)
    ends = wilson(shares, counts)
    axes.errorbar(
        turned * place, shares, np.abs(ends - shares), fmt="none", ecolor=TISSUE, elinewidth=1.0, alpha=0.6, zorder=3
    )
    axes.scatter(turned * place, shares, s=_size(counts, counts.max()), color=TISSUE, edgecolor="white", zorder=4)
    for count in sorted({int(counts.min()), int(counts.max())}):
        label = f"{count} trial{'s' * (count > 1)}"
        axes.scatter([], [], s=_size(count, counts.max()), color=TISSUE, edgecolor="white", label=label)
    a = fitted.threshold
    ends = np.clip(sorted((turned * a.low, turned * a.high)), *sorted((turned * line[0], turned * line[-1])))
    # on the curve, which has lapses; `at` is the share at the threshold without them
    height = float(np.interp(a.value, line, share))
    axes.plot(ends, [height, height], color=FINGER, linewidth=3.0, zorder=5, solid_capstyle="butt",
              label=f"{'PSE' if one.of == 'judged greater' else 'threshold'}, 95 %")  # fmt: skip
    axes.plot([turned * a.value], [height], marker="|", markersize=12, color=FINGER, zorder=5)
    rises = turned * (share[-1] - share[0]) > 0.0  # the corner below the upper end of the curve has no error bars
    axes.legend(fontsize=8, loc="lower right" if rises else "lower left", handletextpad=0.4)
    distance = one.reference is not None and one.of != "judged greater"
    axes.set_xlabel(f"{one.path} [{unit}]{', from the reference' * distance}", fontsize=10)
    axes.set_ylabel(NAMES[one.of])
    axes.set_ylim(-0.03, 1.03)


def pool_levels(
    x: np.ndarray, shares: np.ndarray, counts: np.ndarray, ratio: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels, shares and counts with neighbouring levels joined into at most `GROUPS` groups of similar counts: a
    staircase has many levels with few trials each."""
    if len(x) <= GROUPS:
        return x, shares, counts
    middle = np.cumsum(counts) - 0.5 * counts
    group = np.floor(middle / counts.sum() * GROUPS).astype(int)
    scale = np.log(x) if ratio else x
    total = np.bincount(group, counts, GROUPS)
    used = total > 0.0
    means = (np.bincount(group, counts * value, GROUPS)[used] / total[used] for value in (scale, shares))
    place, share = means
    return np.exp(place) if ratio else place, share, total[used].astype(int)


def wilson(share: np.ndarray, n: np.ndarray) -> np.ndarray:
    """95 % interval (2, n) of a probability from its share in n trials (Wilson, J. Am. Stat. Assoc. 22, 209, 1927)."""
    z = 1.959964
    middle = (share + z * z / (2.0 * n)) / (1.0 + z * z / n)
    half = z * np.sqrt(share * (1.0 - share) / n + z * z / (4.0 * n * n)) / (1.0 + z * z / n)
    return np.array([np.minimum(middle - half, share), np.maximum(middle + half, share)])


def _size(count: ArrayLike, most: int) -> np.ndarray:
    """Area of a dot [pt^2]."""
    return 15.0 + 105.0 * np.asarray(count, float) / most


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
