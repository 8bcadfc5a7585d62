"""Grip and load force of several fingers on a body, their ratio, and the margin to slip of each finger."""

import numpy as np
from matplotlib.figure import Figure

from palpate.messages import Contact, Friction, Load, Proximity
from palpate.messages.grip import Grip
from palpate.views.pictures.style import FINGER, FRICTION, INK, NORMAL, SPEED, TISSUE, figure, legend_above, mean
from palpate.views.pictures.touch import TouchStreams, together

ORDER, OF_A_FINGER = 10, False

COLOURS = (FINGER, NORMAL, SPEED, FRICTION, TISSUE)
LEAST = 0.05  # [1] grip, as a fraction of its maximum, below which the ratio is not drawn
SPAN = 0.05  # [s] window of the mean over which a finger slides
CREEP = 1e-3  # [m/s] slowest sliding; below it friction creeps


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None if no grip was recorded, or nothing was held."""
    grip = touch[Grip]
    if grip is None or not grip["normal"].any():
        return None
    time = grip["time"]
    out = figure(11.5, 8.4, "How the fingers hold the body: grip and load force, and margin to slip")
    upper, middle, lower = out.subplots(3, 1, sharex=True, height_ratios=(3, 2, 3))
    upper.plot(time, grip["grip"], color=NORMAL, label="grip force")
    upper.plot(time, grip["load"], color=FRICTION, label="load force")
    upper.set(ylabel="force [N]", ylim=(0.0, None))
    legend_above(upper)
    mu = touch.settings(touch.stream_of(Grip)).get("mu_static")
    held = grip["grip"] > LEAST * grip["grip"].max()
    middle.plot(time, np.where(held, grip["ratio"], np.nan), color=SPEED)
    if isinstance(mu, float | int):
        middle.axhline(mu, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
        middle.set(title=f"dashed: the coefficient of static friction, {mu:g}", ylim=(0.0, 1.3 * mu))
    middle.set_ylabel("load over\ntwice the grip [1]")
    senders = [edge["producer"] for edge in touch.node(touch.stream_of(Grip)).get("edges", ())]
    every = {finger.stream_of(Load): finger for finger in touch.fingers}
    bottom = min(float(grip["margin"].min()), 0.0) - 0.02 * float(grip["margin"].max())
    for i, margin in enumerate(grip["margin"].T):
        colour, finger = COLOURS[i % len(COLOURS)], every.get(senders[i]) if i < len(senders) else None
        name = f"finger {i + 1}" if finger is None else str(finger.stream_of(Contact)).removeprefix("contact-")
        lower.plot(time, margin, color=colour, label=name)
        if finger is not None and (found := slides(finger)) is not None:
            bar = np.where(found[1], bottom * (1.0 + 1.5 * i), np.nan)
            lower.plot(found[0], bar, color=colour, linewidth=4.0, solid_capstyle="butt")
    lower.axhline(0.0, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
    lower.set_title("normal force less |tangential force| / static friction; bars: the finger slides")
    lower.set_ylabel("margin to slip [N]")
    legend_above(lower)
    touch.over_time(lower, time)
    return out


def slides(finger: TouchStreams) -> tuple[np.ndarray, np.ndarray] | None:
    """Times [s] (n), and whether the finger slides (n): its friction does not stick for most of SPAN, and its mean
    speed along the surface exceeds CREEP. None if friction or speed were not recorded."""
    friction, near = finger[Friction], finger[Proximity]
    if friction is None or near is None:
        return None
    friction, near = together(friction, near)
    time = friction["time"]
    moves = np.linalg.norm([mean(speed, time, SPAN) for speed in near["slip"].T], axis=0) > CREEP
    touching = np.linalg.norm(friction["force"], axis=1) > 0.0
    return time, (mean(1.0 - friction["stick"], time, SPAN) > 0.5) & moves & touching
