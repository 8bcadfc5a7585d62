"""Whether the stiffness of presses is that of a soft material; else a unit of the file may be wrong."""

import math

from palpate.models.fit.tissue.rigs import Rig

SOFT = (20.0, 2e6)  # [Pa] Young's modulus, from hydrogels to rubber; organs of `palpate list tissues`: 1 to 130 kPa


def apparent_modulus(rig: Rig, force: float, depth: float) -> float:
    """Young's modulus [Pa] of the incompressible material that gives a force [N] at a depth [m], by the law of Hertz,
    of the flat punch or of a bar, whatever law is fitted."""
    if rig.kind == "cylinder":
        return force * (rig.height or rig.radius) / (math.pi * rig.radius**2 * depth)
    if rig.kind == "punch":
        return 0.75 * force / (2.0 * rig.radius * depth)
    return 0.75 * force / (4.0 / 3.0 * math.sqrt(rig.radius * depth) * depth)


def check_units(rig: Rig, force: float, depth: float) -> list[str]:
    """A note if no soft material has this stiffness. force [N] at depth [m]."""
    if not (force > 0.0 and depth > 0.0):
        return []
    modulus = apparent_modulus(rig, force, depth)
    if SOFT[0] <= modulus <= SOFT[1]:
        return []
    return [
        f"{force:.3g} N at {1e3 * depth:.3g} mm need a modulus of about {modulus:.2g} Pa; soft materials have "
        f"{SOFT[0]:g} Pa to {1e-6 * SOFT[1]:g} MPa. Are the units of force and indentation right?"
    ]
