"""Chart of the stiffest wall that a device can render."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from palpate.views.pictures.style import ENERGY, FINGER, NORMAL, SPEED, figure, look, save

WALL_LINES = (
    ("passive", NORMAL, "-", "passive, theory"),
    ("stable", SPEED, "-", "stable, theory"),
    ("bare", FINGER, "o", "simulated, without passivity control"),
    ("controlled", ENERGY, "^", "felt with passivity control"),
)
"""Columns of the table, with their colours, marks and labels."""


@look()
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
    save(drawn, path)


def _curve(axes: Axes, rows: list[dict[str, float]], over: str, name: str, mark: str, **look: Any) -> None:
    """Draw one column over another, without zeros."""
    points = [(row[over], row[name]) for row in rows if row[name] > 0.0]
    axes.plot(*zip(*points, strict=True) if points else ([], []), mark, **look)
