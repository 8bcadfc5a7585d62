"""Which part of an error is of discretisation: with refinement errors flatten at the error of the model."""

from collections.abc import Sequence

import numpy as np

from palpate.studies.accuracy.cells import Cell

AXES = {"step": "shorter steps", "mesh": "finer meshes", "basis": "more vertices in its basis"}
"""Axes on which a setting can be called finer than another."""
FLAT = 0.2
"""[1] Change of the force by the last refinement, over what is left, below which an axis has come to its end."""
SMALL = 0.5
"""[1] Share of the error below which the distance from the finest setting is not what it mostly is."""


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
