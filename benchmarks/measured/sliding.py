"""Afferents under a profile that slides under a finger, without the rest of a graph."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Load, Proximity, Subsurface
from palpate.nodes.tactile import Afferents, Relief, Stress
from palpate.physics.afferents.published import DEPTHS

SPEED, RATE, SETTLING = 80e-3, 5000.0, 0.2
DENSITY = 2.4e6  # [1/m²] of each type, denser than in a finger, so that the mean over the fibres varies little


def patch(force: float) -> float:
    """Radius [m] of the contact: 34.6 mm² at 0.11 N, 59.1 mm² at 0.5 N (docs/equations/tactile-flow.md), a power of the
    force between and beyond."""
    area = 34.6e-6 * (force / 0.11) ** (np.log(59.1 / 34.6) / np.log(0.5 / 0.11))
    return float(np.sqrt(area / np.pi))


class Felt(NamedTuple):
    """Stress [Pa] (time, receptors, 6) and displacement of the skin, times E* [N/m] (time, receptors, 3), at the
    receptors `points` [m] (receptors, 3), which have these settings."""

    points: np.ndarray
    stress: np.ndarray
    deflection: np.ndarray
    units: dict


def feel(
    s: np.ndarray,
    height: np.ndarray,
    force: float,
    seconds: float = 0.6,
    reach: float | None = None,
    kernel: str = "biweight",
) -> Felt:
    """What the receptors feel in `SETTLING` + `seconds` under a profile (n) [m]: those within `reach` [m], or 0.8 times
    the radius of the contact, in which the pressure has the shape `kernel`."""
    radius = patch(force)
    units = {"densities": (DENSITY, DENSITY, DENSITY), "reach": reach or 0.8 * radius}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "profile.csv"
        path.write_text("s,height\n" + "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(s, height, strict=True)))
        stress = Stress(radius=radius, reach=radius, depths=DEPTHS, kernel=kernel)
        relief = Relief(
            profile=str(path),
            roughness=0.0,
            direction=(1.0, 0.0, 0.0),
            radius=radius,
            kernel=kernel,
            shortest=0.15e-3,
            **units,
        )
        load = Load(foot=(0, 0, 0), normal=(0, 0, 1), nodes=np.zeros(1, int), forces=np.array([[0.0, 0.0, -force]]))
        found = FakeBus(stress, rate=RATE).publish(load)[0]
        below = Subsurface(points=found.points, stress=found.stress, deflection=found.deflection)
        contact = Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=0, indentation=0,
                          compression_rate=0, indentation_rate=0)  # fmt: skip
        friction = Friction(force=(-0.3 * force, 0, 0), bristle=(0, 0, 0), stick=False)
        slides = FakeBus(relief, rate=RATE, load=load, friction=friction, contact=contact)
        messages = []
        for tick in range(round((SETTLING + seconds) * RATE)):
            foot = (SPEED * (tick + 1) / RATE, 0.0, 0.0)
            slides.hold("proximity", Proximity(foot=foot, normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0.0,
                                               approach=0.0, slip=(SPEED, 0.0, 0.0)))  # fmt: skip
            felt = slides.publish(below)[0]
            messages.append((felt.stress.copy(), felt.deflection.copy()))
    return Felt(felt.points, *(np.array(each) for each in zip(*messages, strict=True)), units)


def fire(felt: Felt, constants: str, **settings: object) -> np.ndarray:
    """Mean rates (3) [1/s] of SA1, RA1 and PC with these constants and settings of the node, after `SETTLING`."""
    bus = FakeBus(Afferents(constants=constants, **settings, **felt.units), rate=RATE)
    kind, counts, begin = bus.node.make_population().kind, np.zeros(3), round(SETTLING * RATE)
    for tick, (stress, deflection) in enumerate(zip(felt.stress, felt.deflection, strict=True)):
        spikes = bus.publish(Subsurface(points=felt.points, stress=stress, deflection=deflection))[0]
        if tick >= begin:
            counts += np.bincount(kind[spikes.unit], minlength=3)
    return counts / np.bincount(kind, minlength=3) / (len(felt.stress) / RATE - SETTLING)
