"""Profiles and states of a pin display from zero to the largest force of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.messages import Pins
from palpate.nodes.display import PinArray
from palpate.physics.display.shape_display import PadContact, pad_displacement
from palpate.views.pictures.style import FAINT, FINGER, INK, NORMAL, SPEED, deformation_colours, figure
from palpate.views.pictures.touch import TouchStreams, together

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ORDER, OF_A_FINGER = 111, False

STEPS = 4  # equal steps of the force
ROOM = 1.25  # [1] height of the axes over that of the profiles
WIDE = 14e-3  # [m] of the profile
OUTSIDE = "outside Hertz theory"
HEADS = ("force\n[N]", "x\n[mm]", "δ\n[mm]", "a\n[mm]", "Hertz\ntheory")


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None if no pins show a force, or their node cannot be made here."""
    sent = touch[Pins]
    if sent is None or touch.contact is None:
        return None
    node = touch.make(touch.stream_of(Pins))
    _, contact = together(sent, touch.contact)
    most = float(contact["force"].max(initial=0.0))
    if not isinstance(node, PinArray) or node.shows != "force" or not most > 0.0:
        return None
    title = f"The display from 0 to {most:.3g} N, on tissue of {node.modulus * 1e-3:g} kPa"
    out = figure(13.2, 5.0, title)
    left, middle, right = out.subplots(1, 3, width_ratios=(4, 4, 3))
    forces = most * np.arange(STEPS + 1) / STEPS
    _profiles(left, node, forces)
    _states(middle, node, most)
    _table(right, node.theory(forces), forces)
    return out


def _profiles(axes: Axes, node: PinArray, forces: np.ndarray) -> None:
    """Draw what actuator and pins move together, along a line through the axis, at each force; dashed: the actuator."""
    r = np.linspace(0.0, WIDE, 300)
    shades = deformation_colours()(np.linspace(0.25, 1.0, len(forces)))
    for force, colour in zip(forces, shades, strict=True):
        state = node.theory(float(force))
        rigid, shape = float(state.approach), pad_displacement(r, state)
        axes.plot(r * 1e3, (rigid + shape) * 1e3, color=colour, label=f"{force:.3g} N")
        axes.axhline(rigid * 1e3, color=colour, linewidth=1.0, linestyle="--")
    axes.plot([], [], color=INK, linewidth=1.0, linestyle="--", label="actuator alone, δ")
    axes.set(xlabel="distance from the axis [mm]", ylabel="motion [mm]", xlim=(0.0, WIDE * 1e3))
    axes.set_ylim(0.0, ROOM * axes.get_ylim()[1])  # for the legend
    axes.set_title("profiles: actuator + pins")
    axes.legend(loc="upper right", fontsize=10, ncols=2)


def _states(axes: Axes, node: PinArray, most: float) -> None:
    """Draw deformation of the pad, rigid motion and radius of the contact over the force."""
    force = np.linspace(0.0, most, 4001)
    state = node.theory(force)
    curves = (
        (state.approach, NORMAL, "rigid motion δ"),
        (state.radius, SPEED, "radius of contact a"),
        (state.deflection, FINGER, "deformation of the pad x"),
    )
    for values, colour, label in curves:
        axes.plot(force, values * 1e3, color=colour, label=label)
    if not state.valid.all():
        edge = force[max(int(np.argmin(state.valid)) - 1, 0)]
        axes.axvspan(edge, most, color=FAINT, alpha=0.45, linewidth=0, zorder=0, label=f"{OUTSIDE}, above {edge:.2g} N")
    axes.set(xlabel="normal force [N]", ylabel="motion, radius [mm]", xlim=(0.0, most), ylim=(0.0, None))
    axes.set_title("states")
    axes.legend(loc="upper left", fontsize=10)


def _table(axes: Axes, state: PadContact, forces: np.ndarray) -> None:
    """Print the states at the forces of the profiles."""
    rows = [
        [f"{force:.3g}", *(f"{1e3 * float(value):.3f}" for value in (x, d, a)), "valid" if ok else "outside"]
        for force, x, d, a, ok in zip(
            forces, state.deflection, state.approach, state.radius, state.valid, strict=True
        )
    ]  # fmt: skip
    axes.set_axis_off()
    printed = axes.table(rows, colLabels=HEADS, loc="upper center", cellLoc="right", edges="horizontal")
    printed.auto_set_font_size(False)
    printed.set_fontsize(10)
    printed.scale(1.0, 2.0)
