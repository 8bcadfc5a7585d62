"""Normal force against approach and against the tissue's indentation: the loop of loading and unloading."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.launch.recording.pictures.touch import Touch, touches, work
from palpate.launch.recording.style import FAINT, FINGER, INK, NORMAL, TISSUE, figure, mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "force"
SPAN = 0.012  # [s] of the mean: short beside a press, long beside the noise of the encoders
RATE_SPAN = 0.04  # [s] of the mean from which the rate is taken
STILL = 4e-3  # [m/s] slower changes of the approach are a rest


def draw(touch: Touch) -> Figure | None:
    """None where the recording holds no contact."""
    contact = touch.contact
    if contact is None or not (found := touches(contact["time"], contact["force"])):
        return None
    approach = contact["compression"] + contact["indentation"]
    chosen = min(found, key=lambda one: _slid(contact["foot"][one]))
    out = figure(11.5, 5.2, "Normal force while the finger presses and lets go")
    left, right = out.subplots(1, 2, sharey=True)
    for axes, way, whose, label in (
        (left, approach, "finger and tissue in series", "approach  e = s1 + s2  [mm]"),
        (right, contact["indentation"], "the tissue alone", "indentation of the tissue  s2  [mm]"),
    ):
        for other in found:
            if other is not chosen:
                _line(axes, way[other], contact["force"][other], contact["time"][other], FAINT, "other touches")
        _loop(axes, way[chosen], contact["force"][chosen], contact["time"][chosen])
        axes.set_xlabel(label)
        axes.set_title(f"{whose}: {work(way[chosen], contact['force'][chosen]) * 1e3:.1f} mJ in the loop")
        axes.set_ylim(bottom=0.0)
        axes.set_xlim(left=0.0)
    left.set_ylabel("normal force [N]")
    handles, labels = left.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    left.legend(unique.values(), unique.keys(), loc="upper left")
    return out


def _slid(foot: np.ndarray) -> float:
    """Way of the foot point along the surface [m]."""
    return float(np.linalg.norm(np.diff(foot, axis=0), axis=1).sum()) if len(foot) > 1 else 0.0


def _line(axes: Axes, way: np.ndarray, force: np.ndarray, time: np.ndarray, colour: str, label: str) -> None:
    axes.plot(way * 1e3, mean(force, time, SPAN), color=colour, linewidth=1.0, label=label)


def _loop(axes: Axes, way: np.ndarray, force: np.ndarray, time: np.ndarray) -> None:
    """One touch: in, rest and out in their colours, arrows along it."""
    axes.plot(way * 1e3, force, ".", color=NORMAL, alpha=0.12, markersize=2.5)
    smooth = mean(force, time, SPAN)
    rate = np.gradient(mean(way, time, RATE_SPAN), time) if len(time) > 2 else np.zeros(len(time))
    for label, colour, part in (
        ("in", TISSUE, rate > STILL),
        ("rest", FINGER, np.abs(rate) <= STILL),
        ("out", NORMAL, rate < -STILL),
    ):
        x = np.where(part, way, np.nan) * 1e3
        axes.plot(x, smooth, color=colour, linewidth=2.4, label=label)
        if label != "rest":
            _arrow(axes, way * 1e3, smooth, np.flatnonzero(part))
    if len(smooth):
        axes.fill(way * 1e3, smooth, color=INK, alpha=0.05, linewidth=0)


def _arrow(axes: Axes, x: np.ndarray, y: np.ndarray, at: np.ndarray) -> None:
    """An arrow half way up the part of the curve with these samples."""
    if len(at) < 8:
        return
    middle = int(at[np.abs(y[at] - 0.55 * y.max()).argmin()])
    back, on = max(middle - 4, int(at[0])), min(middle + 4, int(at[-1]))
    axes.annotate(
        "",
        (x[on], y[on]),
        (x[back], y[back]),
        arrowprops={"arrowstyle": "-|>,head_width=0.45,head_length=0.9", "color": INK, "shrinkA": 0, "shrinkB": 0},
    )
