"""Commanded depth and predicted force of each digit of a hand model, with the band of the measured subject."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.engine.imports import full_name
from palpate.messages import ForceBand, Pose
from palpate.nodes.contact.digit import Digit
from palpate.nodes.contact.probabilistic import LAW_SETTINGS
from palpate.physics.contact.force_band import Band, band_at, truncated_quantile
from palpate.views.pictures.style import FAINT, FINGER, INK, NORMAL, REGION_A, figure, legend_above
from palpate.views.pictures.touch import Columns, TouchStreams, together

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ORDER, OF_A_FINGER = 25, False

MORE = 1.15  # [1] range of the depths of the law that is drawn, over the deepest commanded one


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None without a digit of a hand model."""
    found = digits(touch)
    if not found:
        return None
    out = figure(13.2, 1.0 + 4.2 * len(found), "Force on a digit at its commanded depth, with the band of a subject")
    grid = out.subplots(len(found), 2, squeeze=False, width_ratios=(3, 2))
    for (left, right), (name, node, depth, band) in zip(grid, found, strict=True):
        _over_time(left, name, depth, band)
        _over_depth(right, node, depth, band)
    return out


def digits(touch: TouchStreams) -> list[tuple[str, Digit, np.ndarray, Columns]]:
    """Stream, node, commanded depths [m] (n) and messages of each digit that was recorded with the pose of its pad."""
    recording, found = touch.recording, []
    edges = recording.about.get("plan", {}).get("edges", {})
    for name, stream in recording.streams.items():
        if str(stream.schema["class"]) != full_name(ForceBand) or not isinstance(node := touch.make(name), Digit):
            continue
        poses = [edge["producer"] for edge in edges.get(stream.producer, ()) if edge["port"] == "pose"]
        sent = [s for s, each in recording.streams.items() if each.producer in poses
                and str(each.schema["class"]) == full_name(Pose)]  # fmt: skip
        if not sent:
            continue
        band, pose = together(recording.columns(name), recording.columns(sent[0]))
        if len(band["time"]):
            depth = np.array([node.depth_of(place) for place in pose["position"].tolist()])
            found.append((name, node, depth, band))
    return found


def _over_time(axes: Axes, name: str, depth: np.ndarray, band: Columns) -> None:
    """Draw the predicted force with its band, and the commanded depth below it."""
    time, low, high = band["time"], band["quantiles"].min(axis=1), band["quantiles"].max(axis=1)
    axes.fill_between(time, low, high, color=REGION_A, linewidth=0, label=_share(band))
    axes.plot(time, band["mean"], color=NORMAL, label="predicted force, mean")
    if band["sample"].any():
        axes.plot(time, band["sample"], color=INK, linewidth=1.0, linestyle="--", label="one session, drawn")
    legend_above(axes, fontsize=10)
    top = max(float(high.max()), 1e-3)
    axes.set(xlabel="time [s]", ylabel="force on the pad [N]", xlim=(time[0], time[-1]), ylim=(0.0, 1.1 * top))
    axes.set_title(name)
    below = axes.twinx()
    below.plot(time, 1e3 * depth, color=FINGER, linewidth=1.4)
    below.set_ylabel("commanded depth [mm]", color=FINGER)
    below.set_ylim(0.0, 1.1e3 * max(float(depth.max()), 1e-4))
    below.grid(visible=False)
    below.spines["right"].set_visible(True)


def _over_depth(axes: Axes, node: Digit, depth: np.ndarray, band: Columns) -> None:
    """Draw the law of the subject over the depth, and this run on it."""
    law = Band(*(getattr(node, name) for name in LAW_SETTINGS))
    end = MORE * max(float(depth.max()), law.limit)
    d = np.linspace(0.0, end, 300)
    mean, deviation, _ = band_at(d, law)
    levels = band["levels"][0]
    low, high = (truncated_quantile(level, mean, deviation, law.freedom) for level in (levels.min(), levels.max()))
    axes.fill_between(1e3 * d, low, high, color=REGION_A, linewidth=0, label=_share(band))
    axes.plot(1e3 * d, mean, color=NORMAL, label="mean of the subject")
    axes.axvspan(
        1e3 * law.limit, 1e3 * end, color=FAINT, alpha=0.45, linewidth=0, zorder=0, label="deeper than measured"
    )
    axes.plot(1e3 * depth, band["mean"], color=FINGER, linewidth=3.0, alpha=0.6, label="this run")
    axes.set(xlabel="commanded depth [mm]", ylabel="force on the pad [N]", xlim=(0.0, 1e3 * end), ylim=(0.0, None))
    axes.legend(loc="upper left", fontsize=10)


def _share(band: Columns) -> str:
    levels = band["levels"][0]
    return f"{100.0 * float(levels.max() - levels.min()):.0f} % of the forces"
