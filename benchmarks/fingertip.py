"""The layered fingertip compared with the paper's Table III and its statements, for each set of materials.

    python benchmarks/fingertip.py runs/fingertip [--cells 5] [--pictures folder] [--json]

Presses the printed, the calibrated and the cortical finger on both plates. The folders are those of `palpate build fe
fingertip`: finished runs are loaded, interrupted runs resume. All runs take about an hour on one core.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from fingertip_claims import statements
from scipy.optimize import minimize_scalar

from palpate.models.fe.meshing.fingertip import CALIBRATED, PAPER, FingertipDimensions
from palpate.models.fe.study.press_record import PressRun, Record, record
from palpate.models.fe.study.pressing import Pressing

ENDS = {"printed": {"steel": 0.85e-3, "silicone": 1.3e-3}, "calibrated": {"steel": 2.4e-3, "silicone": 2.4e-3},
        "cortical": {"steel": 0.85e-3, "silicone": 1.3e-3}}  # fmt: skip
"""Set of materials -> plate -> travel of the plate [m], up to or beyond the paper's."""


def fit_divisor(steel: Record) -> float:
    """The divisor of all moduli with the least squared error in indentation at the paper's two points on steel."""
    points = PAPER["steel"]

    def miss(log: float) -> float:
        curve = steel.soften(float(np.exp(log)))
        ends = [min(f, curve.force[-1]) for f, _ in points]
        return sum((curve.at(e)[0] - depth) ** 2 + (e - f) ** 2 for e, (f, depth) in zip(ends, points, strict=True))

    return float(np.exp(minimize_scalar(miss, bounds=(np.log(2.0), np.log(100.0)), method="bounded").x))


def press(name: str, plate: str, cells: int, folder: Path) -> tuple[PressRun, Record]:
    """Compute, resume or load one press."""
    run = PressRun(folder / f"{plate}-{name}-{cells}-0.2")

    def show_load(load: float) -> None:
        print(f"\r{run.folder.name}: {1e3 * load:.2f} mm", end="", file=sys.stderr, flush=True)

    pressed = record(Pressing(FingertipDimensions(cells=cells), plate, name), ENDS[name][plate], run, show_load)
    print(file=sys.stderr)
    return run, pressed


def points(sets: dict[str, dict[str, Record]]) -> list[dict[str, Any]]:
    """Table III: indentations [mm] of the paper and of each set of materials; None if the force was not reached."""
    rows = []
    for plate, marks in PAPER.items():
        for force, paper in marks:
            row: dict[str, Any] = {"plate": plate, "force N": force, "paper mm": 1e3 * paper}
            for name, records in sets.items():
                record = records[plate]
                row[f"{name} mm"] = 1e3 * record.at(force)[0] if force <= record.force[-1] else None
            rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder of the runs")
    parser.add_argument("--cells", type=int, default=5)
    parser.add_argument("--pictures", type=Path, help="folder for the pictures of the calibrated set")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    every = {
        name: {plate: press(name, plate, given.cells, given.folder) for plate in ends} for name, ends in ENDS.items()
    }
    records = {name: {plate: pair[1] for plate, pair in plates.items()} for name, plates in every.items()}
    tables = {"Table III": points(records)}
    tables |= {f"statements, {name}": statements(**plates) for name, plates in records.items()}
    divisor = fit_divisor(records["calibrated"]["steel"].soften(1.0 / CALIBRATED))
    if given.pictures:
        from fingertip_flow import draw

        given.pictures.mkdir(parents=True, exist_ok=True)
        draw({plate: pair[0] for plate, pair in every["calibrated"].items()}, given.pictures)
    if given.json:
        json.dump(tables | {"divisor": divisor}, sys.stdout, indent=2, ensure_ascii=False)
        return
    from tables import show

    for title, rows in tables.items():
        show(title, rows)
    print(f"divisor fitted to the steel points: {divisor:.3g} (the calibrated set has {CALIBRATED})")


if __name__ == "__main__":
    main()
