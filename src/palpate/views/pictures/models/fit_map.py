"""Pictures of `palpate fit map`: the map with its uncertainty and inclusions, and errors on held-out probes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.models.fit.probes.fit import ProbeMap, grid, log_ratio
from palpate.views.pictures.style import (
    FINGER,
    INK,
    NORMAL,
    TISSUE,
    deformation_colours,
    figure,
    legend_above,
    log_ticks,
    look,
    saved,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CELLS = 90  # of a map along its longer side
WIDE = 4.0  # [1] Largest over least stiffness from which the colours are logarithmic


@look()
def draw_map(found: ProbeMap, folder: Path) -> list[Path]:
    return saved(folder, map=stiffness(found), held_out=held_out(found))


def stiffness(found: ProbeMap) -> Figure:
    """Stiffness over that of the median place, and its uncertainty, over the mean plane of the probes."""
    probed, following = (_flat(found, places) for places in (found.ground.places, found.next_places))
    wide, tall = np.ptp(probed, axis=0)
    law = found.fit.law.name
    out = figure(
        11.0, float(np.clip(4.0 * tall / wide, 1.8, 9.0)) + 1.6, f"Stiffness over the probed surface, law {law}"
    )
    left, right = out.subplots(1, 2, sharex=True, sharey=True)
    paint_ratio(left, found)
    _paint(right, found, log_ratio(found, _places(found))[1], "standard deviation of its logarithm", False)
    for axes in (left, right):
        axes.scatter(*probed.T, s=9, facecolor="none", edgecolor="0.35", linewidths=0.7, label="probe")
    right.scatter(*following.T, marker="x", s=50, color=NORMAL, linewidths=2, label="probe next", clip_on=False)
    right.set_ylabel("")
    legend_above(left)
    legend_above(right)
    return out


def paint_ratio(axes: Axes, found: ProbeMap) -> None:
    """Stiffness over that of the median place, and circles of the stiff balls."""
    ratio = np.exp(log_ratio(found, _places(found))[0])
    _paint(axes, found, ratio, "stiffness over that of the median place", ratio.max() > WIDE * ratio.min())
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    for number, one in enumerate(found.inclusions, 1):
        (at,), radius = _flat(found, one.position[None]), 1e3 * one.radius[0]
        axes.plot(at[0] + radius * np.cos(turn), at[1] + radius * np.sin(turn), color=NORMAL, lw=1.8,
                  label="stiff ball" if number == 1 else None)  # fmt: skip
        axes.annotate(str(number), at, color=NORMAL, weight="bold", ha="center", va="center",
                      bbox={"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": "none"})  # fmt: skip


def _paint(axes: Axes, found: ProbeMap, values: np.ndarray, label: str, logarithmic: bool) -> None:
    """Colours of values (k) at the points of the grid."""
    from matplotlib.colors import LogNorm

    plane = grid(found.ground, CELLS)
    (u, column), (v, row) = (np.unique(each, return_inverse=True) for each in plane.T)
    table = np.full((len(v), len(u)), np.nan)
    table[row, column] = values
    painted = axes.pcolormesh(1e3 * u, 1e3 * v, table, cmap=deformation_colours(), rasterized=True,
                              norm=LogNorm() if logarithmic else None, shading="nearest")  # fmt: skip
    bar = axes.figure.colorbar(painted, ax=axes, label=label, location="right", aspect=25)
    bar.outline.set_visible(False)  # type: ignore[operator]
    if logarithmic:
        log_ticks(bar.ax, "y")
    axes.set(aspect="equal", xlabel="along the surface [mm]", ylabel="across [mm]")
    axes.grid(False)


def _places(found: ProbeMap) -> np.ndarray:
    return np.array([found.ground.surface_point(uv) for uv in grid(found.ground, CELLS)])


def _flat(found: ProbeMap, places: np.ndarray) -> np.ndarray:
    """Coordinates (n,2) [mm] of places (n,3) [m] along the axes of the mean plane."""
    return 1e3 * (places - found.ground.middle) @ found.ground.axes.T


def held_out(found: ProbeMap) -> Figure:
    """Errors of the force on held-out probes: distribution for the map and for the mean curve."""
    out = figure(7.0, 3.8, "Force on probes that were held out")
    axes = out.add_subplot()
    count_errors(axes, found)
    legend_above(axes)
    return out


def count_errors(axes: Axes, found: ProbeMap) -> None:
    """Histograms of the errors on held-out probes."""
    by_map, by_mean = found.errors()
    most = 1e3 * float(np.quantile(np.abs(np.concatenate([found.predicted, found.mean_curve])), 0.99))
    edges = np.linspace(-most, most, 60).tolist()
    for errors, rms, colour, name in (
        (found.mean_curve, by_mean, FINGER, "mean curve of the others"), (found.predicted, by_map, TISSUE, "map"),
    ):  # fmt: skip
        axes.hist(np.clip(1e3 * errors, -most, most), edges, histtype="step", lw=1.8, color=colour,
                  label=f"{name}, RMS {1e3 * rms:.3g} mN")  # fmt: skip
    axes.axvline(0.0, color=INK, lw=0.6)
    axes.set(xlabel="predicted minus measured force [mN]", ylabel="rows; ends: all beyond")
