"""What refining a method tells: which part of its error is of discretisation, and how fast it comes to its limit.

With refinement a curve of errors flattens at the error of its model. The order of convergence that is observed stands
beside that of theory.

In time, by three settings whose steps are halved, without any truth: |f(T) - f(T/2)| falls as T^p. The steps of contact
and bodies are implicit Euler, so p = 1. On meshes, by the error against the reference: it falls as h^p. Quadratic
elements have p = 4 in energy where the solution is smooth; where the patch or the contact ends it is not, and p is 2 to
3 (P. Wriggers, Computational Contact Mechanics, Springer 2006, ch. 9); linear ones, as MuJoCo's, have 2. A body that is
condensed to n vertices takes its load, and tells its indentation, through hats as wide as their distance h, with
h² ~ 1/n: that widens the patch by a share of (h/R)², so p = 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.studies.accuracy.cells import Cell

AXES = {"step": "shorter steps", "mesh": "finer meshes", "basis": "more vertices in its basis"}
"""Axes on which a setting can be called finer than another."""
FLAT = 0.2
"""[1] Change of the force by the last refinement, over what is left, below which an axis has come to its end."""
SMALL = 0.5
"""[1] Share of the error below which the distance from the finest setting is not what it mostly is."""
THEORY = {"step": "1", "mesh": "2 to 4", "basis": "2"}
LINEAR = "2"
"""On meshes of linear elements."""
MESHED = ("full-FE", "FElupe", "CalculiX", "MuJoCo")
"""Methods that are refined by cells of their own."""
LEAST = 1e-7
"""[1] Change below which there is nothing to converge."""


def refined(cells: Sequence[Cell]) -> dict[tuple[str, str, str], list[Cell]]:
    """The results on each axis of refinement, by touch, method and axis, the finest last."""
    groups: dict[tuple[str, str, str], list[Cell]] = {}
    for cell in cells:
        if cell.status == "ok" and cell.axis in AXES:
            groups.setdefault((cell.touch, cell.method, cell.axis), []).append(cell)
    return groups


def told_apart(cells: Sequence[Cell]) -> None:
    """Hold each setting against the finest on its axis, and that against the truth. Bodies of one family (the name up
    to its dash) share their axes: what a condensed body's basis is short of, it is short of with dents, too."""
    falling: dict[tuple[str, str], list[str]] = {}
    for (touch, method, axis), own in refined(cells).items():
        if len(own) < 2:
            continue
        for cell in own:
            apart = np.array(cell.trace) - np.array(own[-1].trace)
            cell.discretisation = float(np.sqrt(np.mean(apart**2)))
            cell.finest = own[-1].errors["force"]["rms"]
        if still_falling(own):
            falling.setdefault((touch, family(method)), []).append(axis)
    for cell in cells:
        cell.falling = " ".join(dict.fromkeys(falling.get((cell.touch, family(cell.method)), [])))


def family(method: str) -> str:
    """What its bodies have in common."""
    return method.partition("-")[0]


def still_falling(own: Sequence[Cell]) -> bool:
    """Whether the last refinement of an axis still changed the force by a share of what is left."""
    return (own[-2].discretisation or 0.0) >= FLAT * (own[-1].errors["force"]["rms"])


def mostly(cell: Cell) -> str:
    """What the error mostly is: "model", "discretisation", with the axes on which it still falls, or
    "reference" where it cannot be told."""
    if cell.status != "ok" or cell.discretisation is None:
        return ""
    if cell.at_reference():
        return "reference"
    if cell.discretisation >= SMALL * cell.errors["force"]["rms"]:
        return "discretisation"
    return f"discretisation ({', '.join(cell.falling.split())})" if cell.falling else "model"


@dataclass(frozen=True)
class OrderStudy:
    """A method on one axis of one touch.

    sizes        [s] of the steps, or [1] of cells, see `in_space`; differences [1] of the force over its peak
    observed     [1] order between the two finest
    """

    method: str
    title: str
    touch: str
    axis: str
    sizes: tuple[float, ...]
    differences: tuple[float, ...]

    @property
    def theory(self) -> str:
        """What the order is to be."""
        return LINEAR if self.method == "MuJoCo" and self.axis == "mesh" else THEORY[self.axis]

    @property
    def observed(self) -> float:
        """Order between the two finest settings."""
        (h, k), (a, b) = self.sizes[-2:], self.differences[-2:]
        return float(np.log(a / b) / np.log(h / k))


def studies(cells: Sequence[Cell]) -> list[OrderStudy]:
    """Of every method that was refined in its step, and of the full models on their meshes."""
    result = []
    for (touch, method, axis), own in refined(cells).items():
        if axis == "step":
            sizes, differences = in_time(own)
        elif axis == "basis" or method in MESHED:
            sizes, differences = in_space(own)
        else:
            continue
        if len(sizes) > 1 and min(differences) > LEAST:
            result.append(OrderStudy(method, own[0].title, touch, axis, tuple(sizes), tuple(differences)))
    return result


def in_time(own: Sequence[Cell]) -> tuple[list[float], list[float]]:
    """Steps [s], and by how much halving each changes the force."""
    sizes, differences = [], []
    for cell, finer in pairwise(own):
        if cell.trace and finer.trace and abs(finer.rate / cell.rate - 2.0) < 1e-9:
            sizes.append(1.0 / cell.rate)
            differences.append(float(np.sqrt(np.mean((np.array(cell.trace) - np.array(finer.trace)) ** 2))))
    return sizes, differences


def in_space(own: Sequence[Cell]) -> tuple[list[float], list[float]]:
    """Sizes, and errors as far as they are above the band of the reference. Sizes are those of the cells over the
    radius, or of the triangles of a surface of so many vertices over its side."""
    above = [c for c in own if not c.at_reference()]
    sizes = [
        int(c.fidelity.split()[2]) ** -0.5 if c.axis == "basis" else 1.0 / int(c.fidelity.split()[0]) for c in above
    ]
    return sizes, [c.errors["force"]["rms"] for c in above]
