"""Pictures of `palpate fit tissue`: force and residuals, and the profile of each parameter."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.models.fit.tissue.fit import TissueFit
from palpate.models.fit.tissue.measured import MeasuredPress
from palpate.views.pictures.style import figure, log_ticks, look, saved

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Scaled(NamedTuple):
    """A unit with prefix, and the factor from the SI unit to it."""

    scale: float
    unit: str


@look()
def draw_fit(fit: TissueFit, folder: Path) -> list[Path]:
    return saved(folder, fit=forces(fit), profiles=profiles(fit))


def forces(fit: TissueFit) -> Figure:
    """Force over depth with the fit and the held-out presses; residuals over depth and over time."""
    timed = all(p.time is not None for p in fit.presses)
    out = figure(14.0 if timed else 10.0, 4.4, _result(fit))
    axes = out.subplots(1, 3 if timed else 2)
    far = _prefix(max(float(np.ptp(p.depth)) for p in fit.given), "m")
    near = _prefix(max(float(np.ptp(p.force)) for p in fit.given), "N")
    small = _prefix(max(float(np.abs(r).max()) for r in fit.estimate.residuals), "N")
    # rows that were left out, then the fitted ones
    pairs = zip(fit.presses, fit.given, fit.estimate.touches, strict=True)
    extra = np.concatenate(
        [np.setdiff1d(_points(given, touch), _points(press, touch)) for press, given, touch in pairs]
    )
    if len(extra):
        at = far.scale * extra.real, near.scale * extra.imag
        axes[0].plot(*at, "o", ms=4, mfc="none", color="0.6", label="left out")
    for k, (press, force, touch) in enumerate(zip(fit.presses, fit.estimate.fitted, fit.estimate.touches, strict=True)):
        colour, depth, off = f"C{k % 10}", far.scale * (press.depth - touch), small.scale * (force - press.force)
        axes[0].plot(depth, near.scale * press.force, ".", ms=3, color=colour, label=press.name)
        axes[0].plot(depth, near.scale * force, "k-", lw=1, label=f"{fit.law.name}, fitted" if not k else None)
        axes[1].plot(depth, off, ".-", ms=3, lw=0.5, color=colour)
        if timed and press.time is not None:
            axes[2].plot(press.time, off, ".-", ms=3, lw=0.5, color=colour)
    for each in fit.held_out:
        depth, force, made = each["curve"]
        inside = depth <= fit.deepest * (1.0 + 1e-9)
        for rows, mark, label in ((inside, "x", "held out"), (~inside, "^", "held out, beyond the fitted range")):
            if rows.any():
                x, name = far.scale * depth[rows], f"{each['press']}, {label}"
                axes[0].plot(x, near.scale * force[rows], mark, ms=4, mfc="none", color="0.5", label=name)
                axes[1].plot(x, small.scale * (made - force)[rows], mark, ms=3, mfc="none", color="0.5")
    if any(each["beyond"] for each in fit.held_out):
        for axis in axes[:2]:
            axis.axvline(far.scale * fit.deepest, color="k", lw=0.7, ls="--", label="end of the fitted range")
    axes[0].set(xlabel=f"indentation [{far.unit}]", ylabel=f"force [{near.unit}]")
    axes[0].legend(fontsize=8)
    for axis, label in zip(axes[1:], (f"indentation [{far.unit}]", "time [s]"), strict=False):
        axis.axhline(0.0, color="k", lw=0.5)
        axis.set(xlabel=label, ylabel=f"fit minus force [{small.unit}]")
    return out


def _prefix(largest: float, unit: str) -> Scaled:
    """The unit in which a largest value > 0 lies between 1 and 1000."""
    thousands = min(max(math.ceil(-math.log10(max(largest, 1e-12)) / 3.0), 0), 4)
    return Scaled(1e3**thousands, f"{('', 'm', 'µ', 'n', 'p')[thousands]}{unit}")


def _result(fit: TissueFit) -> str:
    """The law, its error and its first parameter with the interval."""
    first = fit.estimate.parameters[0]
    found = fit.estimate.intervals[first.name]
    ends = "interval withheld" if fit.estimate.withheld else f"{found.low:.4g} to {found.high:.4g}"
    rms = 100.0 * fit.errors()["rms_of_peak"]
    return f"{fit.law.name}: RMS {rms:.2g} % of the peak, {first.name} {found.value:.4g} {first.unit} ({ends})"


def _points(press: MeasuredPress, touch: float) -> np.ndarray:
    """(n,) Indentation [m] as real part and force [N] as imaginary part."""
    return press.depth - touch + 1j * press.force


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
