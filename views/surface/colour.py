"""What colours a surface: how far it moved, the pressure on it, where it slides, how much it is stretched."""

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

    label  what stands beside the bar
    scale  how many of the bar's units are one in SI
    least  end of the bar, in SI, while a run goes on and nothing more has been seen
    """

    name: str
    label: str
    scale: float
    least: float


COLOURS = {
    one.name: one
    for one in (
        Colour("displacement", "displacement of the surface [mm]", 1e3, 4e-3),
        Colour("pressure", "contact pressure [kPa]", 1e-3, 2e3),
        Colour("slip", "slip (1: slides)", 1.0, 1.0),
        Colour("strain", "strain of the surface, largest [%]", 1e2, 0.05),
    )
}


def colour(name: str) -> Colour:
    """The colour of this name. ArgumentError: there is none."""
    if name not in COLOURS:
        raise ArgumentError(f"--colour: found {name!r}, expected one of {', '.join(COLOURS)}")
    return COLOURS[name]


def able(surface: Surface) -> list[str]:
    """Names of the colours that a surface can have: its body may tell no pressure or slip."""
    count = len(surface.nodes)
    told = {"pressure": len(surface.pressure) == count, "slip": len(surface.slipped) == count}
    return [name for name in COLOURS if told.get(name, True)]


def painted(of: Colour, mesh: Any, surface: Surface) -> np.ndarray:
    """Values (V) of all vertices of a mesh, in SI: displacement [m], pressure [Pa], 1 where it slides, or the largest
    principal strain of the triangles round each vertex [1]. Zero where the message says nothing."""
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
    """ArgumentError: one of the surfaces cannot have this colour; `where` says whose they are."""
    for surface in surfaces:
        can = able(surface)
        if of.name not in can:
            more = "; --set effects.pressure=on, where the body can" if of.name == "pressure" else ""
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
    """The next of 1, 2, 5, 10 in its decade; 1 for what is not above zero."""
    if value <= 0.0:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(value))
    return float(next(step for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value * (1 - 1e-9)) * decade)
