"""Grip and load force of several fingers on a body, their ratio, and the margin to slip of each finger."""

import numpy as np
from matplotlib.figure import Figure

from palpate.messages.grip import Grip
from palpate.views.pictures.style import FINGER, FRICTION, INK, NORMAL, SPEED, TISSUE, figure
from palpate.views.pictures.touch import TouchStreams

ORDER, OF_A_FINGER = 10, False

COLOURS = (FINGER, NORMAL, SPEED, FRICTION, TISSUE)


def draw(touch: TouchStreams) -> Figure | None:
    """None if no grip was recorded, or nothing was held."""
    grip = touch[Grip]
    if grip is None or not grip["normal"].any():
        return None
    time = grip["time"]
    out = figure(11.5, 8.4, "How the fingers hold the body: grip and load force, and margin to slip")
    upper, middle, lower = out.subplots(3, 1, sharex=True, height_ratios=(3, 2, 3))
    upper.plot(time, grip["grip"], color=NORMAL, label="grip force")
    upper.plot(time, grip["load"], color=FRICTION, label="load force")
    upper.set(ylabel="force [N]", ylim=(None, 1.25 * max(float(grip["grip"].max()), float(grip["load"].max()))))
    upper.legend(loc="upper left", ncols=2)
    mu = touch.settings(touch.stream_of(Grip)).get("mu_static")
    middle.plot(time, grip["ratio"], color=SPEED)
    if isinstance(mu, float | int):
        middle.axhline(mu, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
        middle.set(title=f"dashed: static friction, {mu:g}, where two opposed fingers slip", ylim=(0.0, 1.3 * mu))
    middle.set_ylabel("load over\ntwice the grip [1]")
    for i, margin in enumerate(grip["margin"].T):
        name = f"finger {i + 1}, {np.max(grip['normal'][:, i]):.2f} N at most"
        lower.plot(time, margin, color=COLOURS[i % len(COLOURS)], label=name)
    lower.axhline(0.0, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
    lower.set_title("normal force of each finger less what holds its tangential force; it slips at 0")
    lower.set_ylabel("margin to slip [N]")
    lower.set_ylim(top=max(1.3 * float(grip["margin"].max()), 1e-3))
    lower.legend(loc="upper left", ncols=len(COLOURS))
    touch.over_time(lower, time)
    return out
