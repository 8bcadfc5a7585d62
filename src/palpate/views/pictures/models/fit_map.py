"""Pictures of `palpate fit map`: the map with its uncertainty and inclusions, and errors on held-out probes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.models.fit.probes.fit import ProbeMap, grid, log_ratio
from palpate.views.pictures.style import DEFORMATION, FINGER, INK, NORMAL, TISSUE, figure, legend_above, look, saved

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@look()
def draw_map(found: ProbeMap, folder: Path) -> list[Path]:
    return saved(folder, map=stiffness(found), held_out=held_out(found))


def stiffness(found: ProbeMap) -> Figure:
    """Stiffness over that of the median place, and its uncertainty, over the mean plane of the probes."""
    from matplotlib.colors import LinearSegmentedColormap

    plane, probed = 1e3 * grid(found.ground, 60), 1e3 * found.ground.plane
    places = np.array([found.ground.surface_point(1e-3 * uv) for uv in plane])
    value, error = log_ratio(found, places)
    wide, tall = np.ptp(probed, axis=0)
    out = figure(11.0, float(np.clip(5.0 * tall / wide, 2.6, 9.0)) + 1.6, "Stiffness over the probed surface")
    colours = LinearSegmentedColormap.from_list("stiffness", DEFORMATION)
    left, right = out.subplots(1, 2, sharex=True, sharey=True)
    for axes, shown, label in (
        (left, np.exp(value), "stiffness, over the median place"),
        (right, error, "standard deviation of its logarithm"),
    ):  # fmt: skip
        size = (0.75 * 72.0 * 4.6 / 60.0) ** 2
        painted = axes.scatter(*plane.T, c=shown, s=size, marker="s", cmap=colours, linewidths=0)
        out.colorbar(painted, ax=axes, label=label, location="bottom", shrink=0.8)
        axes.scatter(*probed.T, s=9, facecolor="none", edgecolor="0.35", linewidths=0.7, label="probe")
        axes.set(aspect="equal", xlabel="along the surface [mm]")
    for number, one in enumerate(found.inclusions):
        _circle(
            left, 1e3 * (one.position - found.ground.middle) @ found.ground.axes.T, 1e3 * one.radius[0], number == 0
        )
    following = 1e3 * (found.next_places - found.ground.middle) @ found.ground.axes.T
    right.scatter(*following.T, marker="x", s=50, color=NORMAL, linewidths=2, label="probe next")
    left.set_ylabel("across [mm]")
    legend_above(left)
    legend_above(right)
    return out


def _circle(axes: Axes, at: np.ndarray, radius: float, labelled: bool) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    axes.plot(at[0] + radius * np.cos(turn), at[1] + radius * np.sin(turn), color=NORMAL, lw=1.8,
              label="stiff ball" if labelled else None)  # fmt: skip


def held_out(found: ProbeMap) -> Figure:
    """Errors of the force on held-out probes: distribution for the map and for the mean curve."""
    by_map, by_mean = found.errors()
    out = figure(7.0, 3.8, "Force on probes that were held out")
    axes = out.add_subplot()
    most = 1e3 * float(np.quantile(np.abs(np.concatenate([found.predicted, found.mean_curve])), 0.99))
    edges = np.linspace(-most, most, 60).tolist()
    for errors, rms, colour, name in (
        (found.mean_curve, by_mean, FINGER, "mean curve of the others"), (found.predicted, by_map, TISSUE, "map"),
    ):  # fmt: skip
        axes.hist(np.clip(1e3 * errors, -most, most), edges, histtype="step", lw=1.8, color=colour,
                  label=f"{name}, RMS {1e3 * rms:.3g} mN")  # fmt: skip
    axes.axvline(0.0, color=INK, lw=0.6)
    axes.set(xlabel="predicted minus measured force [mN]", ylabel="rows")
    legend_above(axes)
    return out
