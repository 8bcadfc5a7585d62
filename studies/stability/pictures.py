"""Pictures of how stiff a wall, or a body, a device can hold."""

import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from palpate.views.pictures.style import ENERGY, FINGER, NORMAL, SPEED, figure

WALL_LINES = (
    ("passive", NORMAL, "-", "passive, theory"),
    ("stable", SPEED, "-", "stable, theory"),
    ("bare", FINGER, "o", "simulated, without passivity control"),
    ("controlled", ENERGY, "^", "felt with passivity control"),
)
BODY_LINES = (
    ("stable", SPEED, "-", "stable, poles"),
    ("bare", FINGER, "o", "simulated, without passivity control"),
    ("controlled", ENERGY, "^", "with passivity control"),
)
"""Columns of the tables, their colours and marks, and what they are."""


def draw_walls(rows: list[dict[str, float]], path: Path) -> None:
    """Left: stiffness over damping at the middle rate and least delay. Right: stiffness over delay at each rate."""
    drawn = figure(11.0, 5.0, "Stiffest wall that the device can render")
    left, right = drawn.subplots(1, 2)
    rates = sorted({one["rate"] for one in rows})
    delay, rate = min(one["delay"] for one in rows), rates[len(rates) // 2]
    plane = [one for one in rows if one["rate"] == rate and one["delay"] == delay]
    for name, colour, mark, label in WALL_LINES:
        _curve(left, plane, "damping", name, mark, color=colour, label=label)
    left.set(xlabel="damping of the wall  B  [N s/m]", ylabel="stiffness of the wall  K  [N/m]", yscale="log",
             title=f"{rate:g} Hz, {delay:g} samples of delay")  # fmt: skip
    least = min(one["damping"] for one in rows)
    for f, width in zip(rates, (0.8, 1.6, 2.6, 3.4, 4.2), strict=False):
        part = [one for one in rows if one["rate"] == f and one["damping"] == least]
        for name, colour, mark, _ in WALL_LINES:
            _curve(right, part, "delay", name, mark, color=colour, linewidth=width, markersize=3 + 1.5 * width)
        right.annotate(f"{f:g} Hz", (part[0]["delay"], max(part[0]["stable"], 1.0)), fontsize=9)
    right.set(xlabel="delay [samples]", yscale="log", title=f"B = {least:g} N s/m; thicker: higher rate")
    drawn.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=len(WALL_LINES))
    drawn.savefig(path)


def draw_bodies(rows: list[dict[str, Any]], path: Path) -> None:
    """Stiffness over delay, a column for each body at the least rate."""
    names, rate = list(dict.fromkeys(row["body"] for row in rows)), min(row["rate"] for row in rows)
    drawn = figure(
        max(3.6 * len(names) + 1.5, 7.6), 4.6, f"Stiffest tissue model that the device can render, {rate:g} Hz"
    )
    axes = drawn.subplots(1, len(names), sharey=True, squeeze=False)[0]
    known = [r[key] for r in rows for key, *_ in BODY_LINES if 0.0 < r[key] < math.inf] or [1e3]
    top, low = 3.0 * max(known), 0.5 * min(known)
    for ax, name in zip(axes, names, strict=True):
        own = [row for row in rows if row["body"] == name and row["rate"] == rate]
        for key, colour, mark, label in BODY_LINES:
            _curve(ax, own, "delay", key, mark, top, color=colour, label=label)
        ax.set(xlabel="delay [samples]", yscale="log", title=name.rpartition(".")[2], ylim=(low, 1.5 * top))
    axes[0].set_ylabel("stiffness  [N/m]")
    drawn.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(BODY_LINES), fontsize=8,
                 title=f"marks at {top:.2g}: all stable", title_fontsize=8)  # fmt: skip
    drawn.savefig(path)


def _curve(
    axes: Axes, rows: list[dict[str, Any]], over: str, name: str, mark: str, top: float = math.inf, **look: Any
) -> None:
    """One column over another, up to `top`; what is 0 is not drawn."""
    points = [(row[over], min(row[name], top)) for row in rows if row[name] > 0.0]
    axes.plot(*zip(*points, strict=True) if points else ([], []), mark, **look)
