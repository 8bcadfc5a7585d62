"""Colours of a surface: displacement, pressure, slip or strain."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.messages import Surface
from palpate.physics.errors import ArgumentError
from palpate.physics.geometry.strain import at_vertices, largest_stretch


@dataclass(frozen=True)
class Colour:
    """One kind of colour.

    label  label of the colour bar
    scale  factor from SI to the unit of the bar
    """

    name: str
    label: str
    scale: float


COLOURS = {
    one.name: one
    for one in (
        Colour("displacement", "displacement of the surface [mm]", 1e3),
        Colour("pressure", "contact pressure [kPa]", 1e-3),
        Colour("slip", "slip (1: slides)", 1.0),
        Colour("strain", "strain of the surface, largest [%]", 1e2),
    )
}


def colour(name: str) -> Colour:
    """The colour of this name. ArgumentError: unknown colour."""
    if name not in COLOURS:
        raise ArgumentError(f"--colour: found {name!r}, expected one of {', '.join(COLOURS)}")
    return COLOURS[name]


def able(surface: Surface) -> list[str]:
    """Names of the available colours of a surface: not all bodies send pressure and slip."""
    count = len(surface.nodes)
    sent = {"pressure": len(surface.pressure) == count, "slip": len(surface.slipped) == count}
    return [name for name in COLOURS if sent.get(name, True)]


def paint_vertices(of: Colour, mesh: Any, surface: Surface) -> np.ndarray:
    """Values (V) of all vertices of a mesh, in SI: displacement [m], pressure [Pa], slip (1: slides), or largest
    principal strain of the triangles around each vertex [1]. Zero for vertices that are not in the message."""
    values = np.zeros(len(mesh.vertices))
    match of.name:
        case "pressure":
            values[surface.nodes] = surface.pressure
        case "slip":
            values[surface.nodes] = surface.slipped
        case "strain":
            moved = np.zeros((len(values), 3))
            moved[surface.nodes] = surface.displacement
            strain = largest_stretch(mesh.vertices, mesh.triangles, moved)
            values = at_vertices(strain, mesh.vertices, mesh.triangles)
        case _:
            values[surface.nodes] = np.linalg.norm(surface.displacement, axis=1)
    return values


def check(of: Colour, surfaces: Sequence[Surface], where: str) -> None:
    """ArgumentError: a surface does not have this colour; `where`: origin of the surfaces."""
    for surface in surfaces:
        can = able(surface)
        if of.name not in can:
            more = "; --set effects.pressure=on, if the body supports it" if of.name == "pressure" else ""
            raise ArgumentError(f"{where}: its body sends no {of.name}{more}. Available colours: {', '.join(can)}")


def top(of: Colour, most: float) -> float:
    """The end of the colour scale, in SI, for values up to `most`."""
    if of.name == "slip":
        return 1.0
    return round_up(most) if of.name == "displacement" else _round(most * of.scale) / of.scale


def round_up(length: float) -> float:
    """The next full millimetre up to 20 mm; below 1 mm and above 20 mm the next of 1, 2, 5, 10 in its decade."""
    if 1e-3 < length <= 20e-3:
        return math.ceil(length * 1e3 - 1e-6) / 1e3
    return _round(length) if length > 0.0 else 1e-3


def _round(value: float) -> float:
    """The next of 1, 2, 5, 10 in its decade; 1 for values that are not positive."""
    if value <= 0.0:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(value))
    return float(next(step for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value * (1 - 1e-9)) * decade)
