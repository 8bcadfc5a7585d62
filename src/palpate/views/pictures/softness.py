"""Softness on a pin display: motion of finger and pins over force for several tissues, and the limits of the theory."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.messages import Pins
from palpate.nodes.display import PinArray
from palpate.physics.display.pins import pin_grid
from palpate.physics.display.shape_display import pad_displacement
from palpate.views.pictures.style import FAINT, FINGER, FRICTION, INK, NORMAL, SPEED, TISSUE, figure
from palpate.views.pictures.touch import Columns, TouchStreams, together

ORDER, OF_A_FINGER = 110, False

OTHERS = {5e3: "5 kPa", 15e3: "15 kPa", 60e3: "60 kPa", np.inf: "rigid"}
LINES = dict(zip(OTHERS, (TISSUE, FRICTION, SPEED, INK), strict=True))
SHOWN = 3.0  # [N] force of the profile, as in the source's figure, but at most the largest force of the run
POINTS = 40  # of the run over force
OUTSIDE = "outside Hertz theory"


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None if no pins show a force, or their node cannot be made here."""
    sent = touch[Pins]
    if sent is None or touch.contact is None:
        return None
    node = touch.make(touch.stream_of(Pins))
    pins, contact = together(sent, touch.contact)
    if not isinstance(node, PinArray) or node.shows != "force" or not (contact["force"] > 0.0).any():
        return None
    limit = 0.25 * node.finger.radius**2 * (1.0 / node.finger.radius + node.curvature)  # [m] δ = a²/R at a = R_f/2
    out = figure(12.5, 4.8, f"A fingerpad on soft tissue ({node.modulus * 1e-3:g} kPa), as the display moves it")
    left, middle, right = out.subplots(1, 3)
    row = int(np.argmax(contact["force"] >= min(SHOWN, float(contact["force"].max()))))
    _profile(left, touch, node, pins, contact, row)
    most = max(float(contact["force"].max()), 1e-9)
    force = np.linspace(0.0, most, 401)
    for modulus, name in OTHERS.items():
        state = node.theory(force, modulus)
        for axes, value in ((middle, state.deflection), (right, state.approach)):
            axes.plot(force, np.where(state.valid, np.nan, value) * 1e3, color=LINES[modulus], lw=1.1, ls="--")
            axes.plot(force, np.where(state.valid, value, np.nan) * 1e3, color=LINES[modulus], lw=2.4)
            axes.plot([], [], color=LINES[modulus], label=name)
    border = node.theory(force[:, None], np.append(np.geomspace(50.0, 1e9, 300), np.inf))
    last = np.maximum(np.count_nonzero(border.valid, axis=0) - 1, 0)
    edge = border.deflection[last, np.arange(len(last))] * 1e3
    middle.fill_between(force[last], 0.0, edge, color=FAINT, alpha=0.45, linewidth=0, zorder=0)
    middle.axvspan(force[last].max(), most, color=FAINT, alpha=0.45, linewidth=0, zorder=0, label=OUTSIDE)
    right.axhspan(limit * 1e3, 1e3, color=FAINT, alpha=0.45, linewidth=0, zorder=0, label=OUTSIDE)
    slow = slice(None, None, max(len(pins["tick"]) // POINTS, 1))
    right.plot(contact["force"][slow], pins["actuator"][slow] * 1e3, "o", color=INK, ms=4, mfc="none",
               label="this run, actuator")  # fmt: skip
    top = float(max(node.theory(most, modulus).approach for modulus in OTHERS)) * 1e3
    middle.set(xlabel="normal force [N]", ylabel="largest deformation x [mm]", xlim=(0, most), ylim=(0, None))
    middle.set_title("deformation of the pad, by tissue")
    end = 1.05 * max(top, limit * 1e3)
    right.set(xlabel="normal force [N]", ylabel="rigid motion δ [mm]", xlim=(0, most), ylim=(0, end))
    right.set_title("rigid motion, by tissue")
    for axes in (middle, right):
        axes.locator_params(axis="x", nbins=5)
    middle.legend(loc="lower right")
    right.legend(loc="upper left")
    return out


def _profile(axes: Axes, touch: TouchStreams, node: PinArray, pins: Columns, contact: Columns, row: int) -> None:
    """Draw the theory along a line through the axis, and the pins and the actuator of this run."""
    tick, force = int(pins["tick"][row]), float(contact["force"][row])
    heights = touch.at(Pins, [tick])[tick].heights
    rows, columns = heights.shape
    distance = np.linalg.norm(pin_grid(rows, columns, node.pitch), axis=-1)
    wide = max(14e-3, 1.2 * float(distance.max()))
    r = np.linspace(0.0, wide, 300)
    state = node.theory(force)
    deformation = pad_displacement(r, state)
    rigid = float(state.approach)
    if not state.valid:
        axes.set_facecolor("#e4e4ea")
        axes.grid(color="white")
    axes.plot(r * 1e3, (rigid + deformation) * 1e3, color=INK, label="both")
    axes.plot(r * 1e3, np.full_like(r, rigid * 1e3), color=NORMAL, label="rigid motion")
    axes.plot(r * 1e3, deformation * 1e3, color=FINGER, label="deformation of the pad")
    axes.plot(distance.ravel() * 1e3, (pins["actuator"][row] + heights.ravel()) * 1e3, "o", color=INK, ms=4, mfc="none",
              label="this run: actuator + pins")  # fmt: skip
    axes.axvline(float(state.radius) * 1e3, color=INK, lw=0.8, ls=":", label="edge of contact")
    axes.set(xlabel="distance from the axis [mm]", ylabel="motion [mm]", xlim=(0, wide * 1e3))
    axes.set_ylim(0.0, 1.9e3 * float(rigid + deformation.max()))
    holds = "" if state.valid else f", {OUTSIDE}"
    axes.set_title(f"{force:.2g} N: contact radius {float(state.radius) * 1e3:.1f} mm{holds}", fontsize=11)
    axes.legend(loc="upper right", fontsize=9)
