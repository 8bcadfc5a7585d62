"""Results of a pressed fingertip (force, contact area and isostrain volumes against indentation), and their folder."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.meshing.fingertip import PAPER, divisor_and_bone
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.study.pressing import Pressing
from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.errors import ArgumentError
from palpate.physics.readable import MOST_TEXT, check_readable

LEVELS = np.array([0.05, 0.1, 0.15, 0.2, 0.3, 0.4])  # Equivalent strains at which volumes are recorded


@dataclass(frozen=True)
class Record:
    """Results of a pressing, row by row from zero force.

    indentation [m] (k,), force [N] (k,), area [m²] (k,), levels [1] (l,), volumes [m³] (k,l)
    """

    indentation: np.ndarray
    force: np.ndarray
    area: np.ndarray
    levels: np.ndarray
    volumes: np.ndarray

    def at(self, force: float) -> tuple[float, float, np.ndarray]:
        """Indentation, area and volumes at a force [N], interpolated. ValueError: the force is not reached."""
        if not 0.0 <= force <= self.force[-1]:
            raise ValueError(f"force {force} N: the record ends at {self.force[-1]:.4g} N")
        volumes = np.array([np.interp(force, self.force, column) for column in self.volumes.T])
        first, second = (float(np.interp(force, self.force, x)) for x in (self.indentation, self.area))
        return first, second, volumes

    def soften(self, divisor: float) -> Record:
        """The record for moduli divided by a number, on a rigid plate: the same motion, with divided forces."""
        return replace(self, force=self.force / divisor)


class PressRun:
    """The folder of a run: settings, mesh, a table with one row per step, the displacements of each step, and the last
    state of the solver. A step is written completely or not at all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def begin(self, pressing: Pressing) -> list[list[float]]:
        """Create the folder for a pressing, or resume its interrupted run. Returns the rows so far. ArgumentError: the
        folder contains a run with other settings, or is damaged."""
        plain = json.loads(json.dumps(pressing.settings()))
        first = [0.0] * (3 + len(LEVELS))
        if not (self.folder / "run.json").exists():
            mesh = pressing.solver.mesh
            self._write("mesh.npz", points=mesh.points, elements=mesh.elements, region=mesh.region)
            with replacing(self.folder / "run.json") as part:
                part.write_text(json.dumps(plain, indent=2))
            return [first]
        other = differing(self.settings(), plain)
        if other is not None:
            name, there, here = other
            raise ArgumentError(
                f"{self.folder}: contains a run with {name} {there}, this one has {here}. Use another folder, or "
                "remove that one"
            )
        if not (self.folder / "state.npz").exists():
            return [first]
        try:
            pressing.solver.resume(self.folder / "state.npz")
        except DAMAGED as error:
            raise self._damage_error("state.npz", error) from None
        rows = self.table()
        rows = rows[rows[:, 0] <= pressing.solver.load * (1.0 + 1e-9)]
        if abs(rows[-1, 0] - pressing.solver.load) > 1e-9 * pressing.solver.load:
            raise self._damage_error("table.npz", f"no row of the last step, {1e3 * pressing.solver.load:.4g} mm")
        return rows.tolist()

    def keep(self, pressing: Pressing, rows: list[list[float]]) -> None:
        """Write a step; the state comes last, so that an incomplete step is repeated."""
        moved = pressing.solver.displacement
        self._write(f"step-{len(rows) - 1:03d}.npz", displacement=moved.astype(np.float32))
        self._write("table.npz", rows=np.array(rows))
        pressing.solver.save(self.folder / "state.npz")

    def settings(self) -> dict[str, Any]:
        """Settings of the run. ArgumentError: no run."""
        try:
            check_readable(self.folder / "run.json", MOST_TEXT)
            settings = json.loads((self.folder / "run.json").read_text())
        except (OSError, ValueError, RecursionError) as error:
            raise self._damage_error("run.json", error) from None
        if not isinstance(settings, dict) or not {"plate", "divisor", "bone", "friction", "finger"} <= set(settings):
            raise self._damage_error("run.json", "expected the settings of a pressing")
        return settings

    def table(self) -> np.ndarray:
        """Rows (k, 3 + l): indentation, force, area, volumes."""
        rows = self._read("table.npz")["rows"]
        if rows.ndim != 2 or rows.shape[1] != 3 + len(LEVELS) or not np.isfinite(rows).all():
            raise self._damage_error("table.npz", f"found {rows.shape}, expected finite rows of {3 + len(LEVELS)}")
        return rows

    def record(self) -> Record:
        """The record so far. ArgumentError: no run."""
        return as_record(self.table().tolist())

    def mesh(self) -> TetMesh:
        """The mesh, plate included. ArgumentError: no run."""
        arrays = self._read("mesh.npz")
        try:
            return TetMesh(arrays["points"], arrays["elements"], arrays["region"])
        except DAMAGED as error:
            raise self._damage_error("mesh.npz", error) from None

    def displacement(self, row: int) -> np.ndarray:
        """Displacement [m] (N,3) of a row of the table. ArgumentError: a missing step."""
        if row == 0:
            return np.zeros_like(self.mesh().points)
        return self._read(f"step-{row:03d}.npz")["displacement"].astype(np.float64)

    def _read(self, name: str) -> dict[str, np.ndarray]:
        try:
            return read_arrays(self.folder / name)
        except ArchiveError as error:
            raise self._damage_error(name, error) from None

    def _write(self, name: str, **arrays: Any) -> None:
        with replacing(self.folder / name) as part:
            np.savez_compressed(part, allow_pickle=False, **arrays)

    def _damage_error(self, name: str, reason: object) -> ArgumentError:
        path = self.folder / name
        if not path.exists():
            inside = sorted(file.parent for file in self.folder.glob(f"*/{name}"))
            such = f", such as {inside[0]}" if inside else ""
            return ArgumentError(
                f"{self.folder}: no {name} in it. Expected a folder that `palpate build fe fingertip` has written{such}"
            )
        return ArgumentError(f"{path}: damaged: {reason}. Remove {self.folder} and run again")


def differing(first: dict[str, Any], second: dict[str, Any]) -> tuple[str, Any, Any] | None:
    """The first setting in which two runs differ, and its values; None: they are equal."""
    for name in first | second:
        there, here = first.get(name), second.get(name)
        if there == here:
            continue
        if isinstance(there, dict) and isinstance(here, dict):
            inner = differing(there, here)
            return None if inner is None else (f"{name}.{inner[0]}", *inner[1:])
        return name, there, here
    return None


DAMAGED = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)  # Exceptions of reading a damaged file


def record(pressing: Pressing, end: float, run: PressRun | None = None, report: Report = unheard) -> Record:
    """Press until the plate has risen by `end` [m]. With `run`, each step is saved in its folder, and an interrupted
    run resumes. ConvergenceError: a failed step; earlier steps are in the folder. ArgumentError: a folder of another
    run, or a damaged one."""
    rows = [[0.0] * (3 + len(LEVELS))] if run is None else run.begin(pressing)
    report(pressing.solver.load)

    def keep(load: float) -> None:
        rows.append([load, pressing.force, pressing.area, *pressing.volumes(LEVELS)])
        if run is not None:
            run.keep(pressing, rows)
        report(load)

    if pressing.solver.load < end:
        pressing.solver.advance(end, keep)
    return as_record(rows)


def as_record(rows: list[list[float]]) -> Record:
    table = np.array(rows)
    return Record(table[:, 0], np.maximum.accumulate(table[:, 1]), table[:, 2], LEVELS, table[:, 3:])


def check_pair(runs: dict[str, PressRun], scaled: bool = False) -> float:
    """Check that the runs, by plate, are of the same finger on these plates. Returns the ratio of the divisors, 1
    unless `scaled`. ArgumentError: they are not."""
    run_settings = {plate: run.settings() for plate, run in runs.items()}
    for plate, settings in run_settings.items():
        if settings.get("plate") != plate:
            raise ArgumentError(f"{runs[plate].folder}: a run on {settings.get('plate')}, expected one on {plate}")
    hard, soft = ({k: v for k, v in s.items() if k != "plate"} for s in run_settings.values())
    ratio = float(soft["divisor"]) / float(hard["divisor"])
    if scaled:
        hard |= {"divisor": soft["divisor"]}
    other = differing(hard, soft)
    if other is not None:
        raise ArgumentError(f"{other[0]} is {other[1]} on steel, {other[2]} on silicone; expected the same in both")
    return ratio


def numbers(plate: str, material: str, record: Record) -> dict[str, Any]:
    """The record as plain data, with the points of the paper."""
    divisor, bone = divisor_and_bone(material)
    return {
        "plate": plate, "material": material, "divisor": divisor, "bone": bone,
        **{name: values.tolist() for name, values in vars(record).items()},
        "paper": [
            {"force": f, "indentation": d, "found": record.at(f)[0] if f <= record.force[-1] else None}
            for f, d in PAPER[plate]
        ],
    }  # fmt: skip
