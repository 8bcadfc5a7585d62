"""One touch computed by several models: curves and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.records.compare import Variant
from palpate.views.pictures.style import figure as blank

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(variants: Sequence[Variant], path: Path) -> None:
    """One picture: force and indentation over time of every variant, and their differences from the first."""
    figure = drawn(variants)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=140)


def drawn(variants: Sequence[Variant]) -> Figure:
    """The figure of `draw`."""
    figure = blank(11, 6.5, f"One touch, {len(variants)} variants; differences from {variants[0].name}")
    axes = figure.subplots(2, 2, sharex=True)
    first = np.array(variants[0].curves).reshape(-1, 3)
    units = ((1, "force [N]", 1.0), (2, "indentation [mm]", 1e3))
    for (column, label, factor), (above, below) in zip(units, axes.T, strict=True):
        for variant in variants:
            curve = np.array(variant.curves).reshape(-1, 3)
            above.plot(curve[:, 0], curve[:, column] * factor, label=variant.name, linewidth=1.2)
            times, mine, theirs = np.intersect1d(curve[:, 0], first[:, 0], return_indices=True)
            below.plot(times, (curve[mine, column] - first[theirs, column]) * factor, linewidth=1.2)
        above.set_ylabel(label)
        below.set_ylabel(f"difference, {label}")
        below.set_xlabel("time [s]")
        for axis in (above, below):
            axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8)
    return figure
