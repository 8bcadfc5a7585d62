"""Time that a pressed fingertip sticks, by inclination, for three pulps: python docs/pictures/angles.py [folder]

beam-bundle-angles.png   contact area, friction and time to full sliding over the angle; sections of the three pulps

The fingertip is pressed 2 mm deep until it rests, then drawn back at 2 mm/s. Dashed: estimate mu F_n / (k v) of the
time with the lateral stiffness k of all beams in contact.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from palpate.physics.fingertip.anatomy import Anatomy
from palpate.physics.fingertip.beam_bundle import BundleState, step
from palpate.physics.fingertip.surfaces import FingertipSurfaces, fill
from palpate.views.pictures.style import FINGER, NORMAL, SPEED, TISSUE, figure, look

PULPS = {
    "pulp with a bulge of 2.2 mm (the default)": (Anatomy(), TISSUE),
    "half the bulge": (Anatomy(bulge=1.1e-3, palmar=6.3e-3), FINGER),
    "no bulge: a straight pulp": (Anatomy(bulge=0.0, palmar=7.4e-3), NORMAL),
}
"""Name -> shape and colour; all have the same depth where the default is thickest."""
ANGLES = np.arange(0.0, 76.0, 7.5)
DEPTH, SPEED_ALONG, MU, PITCH = 2e-3, 2e-3, 0.7, 0.8e-3


class SlideForces(NamedTuple):
    """Contact area [m²], friction in full sliding [N], time to full sliding [s], and its estimate [s]."""

    area: float
    friction: float
    time: float
    expected: float


def slide(tip: FingertipSurfaces, degrees: float, dt: float = 1e-2) -> SlideForces:
    """Press, wait until the beams are at rest, draw back until every node slides."""
    body = fill(tip, DEPTH, pitch=PITCH, angle=np.radians(degrees))
    state = BundleState(body)
    for _ in range(40):
        force = step(body, state, DEPTH, (0.0, 0.0), MU, 1.0)
    touching = state.normal > 0
    expected = MU * force[2] / (body.lateral[touching].sum() * SPEED_ALONG)
    time = 0.0
    while np.hypot(*force[:2]) < 0.99 * MU * force[2] and time < 5.0:
        force = step(body, state, DEPTH, (0.0, SPEED_ALONG * dt), MU, dt)
        time += dt
    return SlideForces(touching.sum() * body.cell, float(np.hypot(*force[:2])), time, float(expected))


def draw(path: Path) -> None:
    """One figure, four panels."""
    with look():
        out = figure(13.0, 7.4, "Inclination of a fingertip: contact, friction and stick")
        (shape, area), (friction, stick) = out.subplots(2, 2)
        for name, (anatomy, colour) in PULPS.items():
            y = np.linspace(0, anatomy.length, 400)
            _, palmar, dorsal, start, cap = anatomy.axes("skin", y)
            round_ = np.sqrt(1 - np.maximum(1 - (y - start) / cap, 0) ** 2)
            shape.plot(y * 1e3, -palmar * round_ * 1e3, color=colour, label=name)
            shape.plot(y * 1e3, dorsal * round_ * 1e3, color="0.7", linewidth=1.0)
            slides = [slide(anatomy.fingertip(), degrees) for degrees in ANGLES]
            area.plot(ANGLES, [s.area * 1e6 for s in slides], "o-", color=colour, markersize=4)
            friction.plot(ANGLES, [s.friction for s in slides], "o-", color=colour, markersize=4)
            stick.plot(ANGLES, [s.time for s in slides], "o-", color=colour, markersize=4)
            stick.plot(ANGLES, [s.expected for s in slides], "--", color=colour, linewidth=1.0)
        stick.plot([], [], "--", color=SPEED, linewidth=1.0, label="μ Fn / (k v)")
        shape.set(title="outline in the plane of symmetry", xlabel="tip  ←  y [mm]  →  hand",
                  ylabel="pulp  ←  z [mm]  →  nail", aspect="equal")  # fmt: skip
        area.set(title="area in contact, 2 mm deep", ylabel="contact [mm²]")
        friction.set(title="friction when every node slides", ylabel="friction [N]")
        stick.set(title="time until every node slides, at 2 mm/s", ylabel="time [s]")
        for axes in (area, friction, stick):
            axes.set(xlabel="inclination of the finger [°]", xlim=(-2, 77))
            axes.set_ylim(bottom=0.0)
        shape.legend(loc="upper center", bbox_to_anchor=(0.5, -0.25), ncols=1)
        stick.legend(loc="lower left")
        FigureCanvasAgg(out)
        out.savefig(path, dpi=100)


if __name__ == "__main__":
    from target import folder

    target = folder(__doc__) / "beam-bundle-angles.png"
    draw(target)
    print(target)
