"""The energy of a touch: what the hand put in, where it is, and what was made, as the ledger tells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.messages import Ledger
from palpate.views.pictures.style import ENERGY, FAINT, FINGER, FRICTION, INK, NORMAL, SPEED, TISSUE, figure
from palpate.views.pictures.touch import Touch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "energy"
PARTS = ("fingertip", FINGER), ("tissue", TISSUE), ("friction", FRICTION)


def draw(touch: Touch) -> Figure | None:
    """None where no ledger was kept."""
    ledger = touch.ledger
    if ledger is None:
        return None
    time, bound = ledger["time"], touch.settings(touch.recording.stream_of(Ledger)).get("bound", 0.0)
    out = figure(11.5, 8.4, "Energy of the touch: what the hand put in, and where it is")
    upper, middle, lower = out.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    layers = [ledger[f"{part}_{kind}"] * 1e3 for kind in ("dissipated", "stored") for part, _ in PARTS]
    labels = [f"{part}, {kind}" for kind in ("dissipated", "stored") for part, _ in PARTS]
    colours = [colour for _ in range(2) for _, colour in PARTS]
    floor = np.zeros(len(time))
    for i, (layer, label, colour) in enumerate(zip(layers, labels, colours, strict=True)):
        upper.fill_between(
            time, floor, floor + layer, color=colour, alpha=0.35 if i < 3 else 0.9, linewidth=0, label=label
        )
        floor = floor + layer
    upper.plot(time, ledger["hand"] * 1e3, color=INK, linewidth=1.3, label="work of the hand")
    upper.set_ylabel("energy [mJ]")
    unexplained = float(np.abs(ledger["unexplained"]).max() * 1e3)
    upper.set_title(f"hand {ledger['hand'][-1] * 1e3:.1f} mJ in all; at most {unexplained:.2g} mJ that nobody has")
    upper.legend(loc="upper left", ncols=2, fontsize=9)
    for name, colour in (("controller", NORMAL), ("sampling", ENERGY), ("unexplained", SPEED)):
        middle.plot(time, ledger[name] * 1e3, color=colour, linewidth=1.3, label=name)
    middle.axhline(0.0, color=FAINT, linewidth=0.8)
    middle.set_ylabel("energy [mJ]")
    middle.set_title("taken by the controller, lost by sampling (negative: made), and what nobody has")
    middle.legend(loc="lower left", ncols=3, fontsize=9)
    lower.plot(time, ledger["made"] * 1e3, color=TISSUE, linewidth=1.3)
    if bound:
        lower.axhline(bound * 1e3, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
    tripped = np.flatnonzero(ledger["tripped"])
    text = f"tripped at {time[tripped[0]]:.3f} s" if len(tripped) else "never tripped"
    limit = f", beyond {bound * 1e3:g} mJ the force is taken away" if bound else ""
    lower.set_title(f"most that one part gave out and cannot have had{limit}; {text}")
    lower.set_ylabel("energy [mJ]")
    lower.set_yscale("symlog", linthresh=0.1)
    lower.set_ylim(bottom=0.0)
    lower.set_xlabel("time [s]")
    lower.set_xlim(time[0], max(time[-1], time[0] + 1e-3))
    return out
