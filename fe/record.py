"""What a pressing of the fingertip gave: force, contact area and isostrain volumes against indentation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from palpate.fe.fingertip import PAPER, Pressing
from palpate.physics.tactile import isostrain_volume

LEVELS = np.array([0.05, 0.1, 0.15, 0.2, 0.3, 0.4])
"""Equivalent strains at which volumes are recorded."""


@dataclass(frozen=True)
class Record:
    """What a pressing gave, row by row from zero force.

    indentation [m] (k,), force [N] (k,), area [m²] (k,), levels [1] (l,), volumes [m³] (k,l)
    """

    indentation: np.ndarray
    force: np.ndarray
    area: np.ndarray
    levels: np.ndarray
    volumes: np.ndarray

    def at(self, force: float) -> tuple[float, float, np.ndarray]:
        """Indentation, area and volumes at a force [N], between the rows.

        ValueError: the record does not reach that force.
        """
        if not 0.0 <= force <= self.force[-1]:
            raise ValueError(f"force {force} N: the record ends at {self.force[-1]:.4g} N")
        volumes = np.array([np.interp(force, self.force, column) for column in self.volumes.T])
        first, second = (float(np.interp(force, self.force, x)) for x in (self.indentation, self.area))
        return first, second, volumes

    def at_depth(self, indentation: float) -> float:
        """Force [N] at an indentation [m], between the rows."""
        return float(np.interp(indentation, self.indentation, self.force))

    def softened(self, divisor: float) -> Record:
        """The same pressing on a rigid plate with all moduli divided: the same motion, the forces divided."""
        return replace(self, force=self.force / divisor)


def record(
    pressing: Pressing, end: float, folder: Path | None = None, report: Callable[[float], None] | None = None
) -> Record:
    """Press until the plate has risen by `end` [m]. With a folder, each step is kept there and a run that was broken
    off goes on from its last step.

    ConvergenceError: a step that fails; the steps before it are in the folder.
    """
    rows: list[list[float]] = [[0.0] * (3 + len(LEVELS))]
    state = None if folder is None else folder / "state.npz"
    table = None if folder is None else folder / "table.npy"
    if state is not None and table is not None and state.exists() and table.exists():
        pressing.solver.resume(state)
        rows = np.load(table).tolist()

    def keep(load: float) -> None:
        values, volumes = pressing.strain()
        rows.append([load, pressing.force, pressing.area, *isostrain_volume(values, volumes, LEVELS)])
        if state is not None and table is not None:
            state.parent.mkdir(parents=True, exist_ok=True)
            np.save(table, np.array(rows))
            pressing.solver.save(state)
        if report is not None:
            report(load)

    if pressing.solver.load < end:
        pressing.solver.advance(end, keep)
    return _record(rows)


def read_record(folder: Path) -> Record:
    """What `record` has kept in a folder."""
    return _record(np.load(folder / "table.npy").tolist())


def _record(rows: list[list[float]]) -> Record:
    found = np.array(rows)
    return Record(found[:, 0], np.maximum.accumulate(found[:, 1]), found[:, 2], LEVELS, found[:, 3:])


def fit_divisor(steel: Record) -> float:
    """The divisor of all moduli whose steel curve passes the paper's two steel points with the least squared error in
    indentation."""
    points = PAPER["steel"]

    def miss(log: float) -> float:
        curve = steel.softened(float(np.exp(log)))
        ends = [min(f, curve.force[-1]) for f, _ in points]
        return sum((curve.at(e)[0] - depth) ** 2 + (e - f) ** 2 for e, (f, depth) in zip(ends, points, strict=True))

    return float(np.exp(minimize_scalar(miss, bounds=(np.log(2.0), np.log(100.0)), method="bounded").x))
