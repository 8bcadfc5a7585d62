"""Writes the results of the accuracy benchmark: table, page, the picture if matplotlib is installed, and provenance."""

import csv
import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from palpate.engine.provenance import machine
from palpate.physics.archive import replacing
from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.output import page
from palpate.studies.accuracy.output.pareto import of_bodies, summaries
from palpate.studies.accuracy.reference import QUANTITIES
from palpate.studies.accuracy.reference_solvers import missing

PLAIN = [field.name for field in fields(Cell) if field.name not in ("errors", "kept")]
MEASURES = ("rms", "worst", "band")


def about() -> dict[str, Any]:
    """Machine, versions and missing solvers."""
    versions = {**machine("numpy", "scipy", "numba"), "seeds": "none, no random numbers are used"}
    return versions | ({"not installed": "; ".join(out)} if (out := missing()) else {})


def write_report(cells: list[Cell], provenance: dict[str, Any], folder: Path) -> dict[str, Path]:
    """Write all files; their paths by name."""
    table(cells, provenance, folder / "accuracy.csv")
    overview = _draw_cells(cells, folder / "overview.png")
    page.write(cells, provenance, overview, folder / "accuracy.md")
    files = {"page": folder / "accuracy.md", "table": folder / "accuracy.csv"}
    return files | ({} if overview is None else {"overview": overview})


def table(cells: Sequence[Cell], provenance: dict[str, Any], path: Path) -> None:
    """Write a `#` line with the provenance as JSON, then a row per cell: [s], [byte], errors over the peak."""
    names = [*PLAIN, *(f"{q} {m}" for q in QUANTITIES for m in MEASURES)]
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {json.dumps(provenance, ensure_ascii=False, default=str)}\n")
        rows = csv.DictWriter(file, names)
        rows.writeheader()
        for cell in cells:
            row: dict[str, Any] = {n: "" if getattr(cell, n) is None else getattr(cell, n) for n in PLAIN}
            errors = {f"{q} {m}": error[m] for q, error in cell.errors.items() for m in MEASURES}
            rows.writerow({**row, **errors})


def _draw_cells(cells: list[Cell], path: Path) -> Path | None:
    """The path of the picture; None if matplotlib is missing."""
    try:
        from palpate.studies.accuracy.output.pictures import overview
    except ImportError:
        return None
    overview(summaries(of_bodies(cells)), cells, path)
    return path
