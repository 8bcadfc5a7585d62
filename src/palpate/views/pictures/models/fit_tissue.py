"""Pictures of `palpate fit tissue`: force and residuals, and the profile of each parameter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.models.fit.tissue.fit import TissueFit
from palpate.models.fit.tissue.measured import MeasuredPress
from palpate.views.pictures.style import figure, log_ticks, look, saved

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@look()
def draw_fit(fit: TissueFit, folder: Path) -> list[Path]:
    return saved(folder, fit=forces(fit), profiles=profiles(fit))


def forces(fit: TissueFit) -> Figure:
    """Force over depth with the fit and the held-out presses; residuals over depth and over time."""
    timed = all(p.time is not None for p in fit.presses)
    out = figure(14.0 if timed else 10.0, 4.4, f"Fit of the law {fit.law.name}")
    axes = out.subplots(1, 3 if timed else 2)
    pairs = zip(fit.presses, fit.given, fit.estimate.touches, strict=True)
    extra = np.concatenate(
        [np.setdiff1d(_points(given, touch), _points(press, touch)) for press, given, touch in pairs]
    )
    if len(extra):
        axes[0].plot(extra.real, extra.imag, "o", ms=4, mfc="none", color="0.6", label="left out")
    for k, (press, force, touch) in enumerate(zip(fit.presses, fit.estimate.fitted, fit.estimate.touches, strict=True)):
        colour, depth, off = f"C{k % 10}", 1e3 * (press.depth - touch), force - press.force
        axes[0].plot(depth, press.force, ".", ms=3, color=colour, label=press.name)
        axes[0].plot(depth, force, "k-", lw=1, label=f"{fit.law.name}, fitted" if not k else None)
        axes[1].plot(depth, off, ".-", ms=3, lw=0.5, color=colour)
        if timed and press.time is not None:
            axes[2].plot(press.time, off, ".-", ms=3, lw=0.5, color=colour)
    for each in fit.held_out:
        depth, force, made = each["curve"]
        inside = depth <= fit.deepest * (1.0 + 1e-9)
        for rows, mark, label in ((inside, "x", "held out"), (~inside, "^", "held out, beyond the fitted range")):
            if rows.any():
                at = 1e3 * depth[rows]
                axes[0].plot(at, force[rows], mark, ms=4, mfc="none", color="0.5", label=f"{each['press']}, {label}")
                axes[1].plot(at, (made - force)[rows], mark, ms=3, mfc="none", color="0.5")
    if any(each["beyond"] for each in fit.held_out):
        for axis in axes[:2]:
            axis.axvline(1e3 * fit.deepest, color="k", lw=0.7, ls="--", label="end of the fitted range")
    axes[0].set(xlabel="indentation [mm]", ylabel="force [N]")
    axes[0].legend(fontsize=8)
    for axis, label in zip(axes[1:], ("indentation [mm]", "time [s]"), strict=False):
        axis.axhline(0.0, color="k", lw=0.5)
        axis.set(xlabel=label, ylabel="fit minus force [N]")
    return out


def _points(press: MeasuredPress, touch: float) -> np.ndarray:
    """(n,) Indentation [mm] as real part and force [N] as imaginary part."""
    return 1e3 * (press.depth - touch) + 1j * press.force


def profiles(fit: TissueFit) -> Figure:
    """Profile of the sum of squares over each parameter, scaled so that it is 1 at the ends of the 95 % interval."""
    parameters = fit.estimate.parameters
    out = figure(max(3.6 * len(parameters), 5.0), 3.8, "Profile of each parameter")
    for axis, p in zip(out.subplots(1, len(parameters), squeeze=False)[0], parameters, strict=True):
        interval = fit.estimate.intervals[p.name]
        at, level = np.array([point for point in interval.curve if point[1] < 6.0]).T
        axis.plot(at, level, "o-", ms=3)
        axis.axhline(1.0, color="tab:red", lw=1, label="95 %")
        if fit.estimate.withheld:  # its interval is the whole range of the search
            axis.plot([], [], " ", label="interval withheld")
        else:
            axis.axvspan(interval.low, interval.high, fc="0.9", ec="0.6", lw=0.8, label="interval reported")
        if p.log and at[0] > 0.0 and at[-1] > 4.0 * at[0]:
            log_ticks(axis)
        else:
            axis.locator_params(axis="x", nbins=4)  # more would overlap
        axis.set(xlabel=f"{p.name} [{p.unit}]", ylabel="rise of the sum of squares", ylim=(-0.1, 4.0))
        axis.legend(fontsize=8)
    return out
