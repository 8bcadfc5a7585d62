"""Results as a file of comma-separated values, and back: what the pictures and the page are made from."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.limits import mostly
from palpate.studies.accuracy.truth import QUANTITIES

PLAIN = {
    "touch": str, "method": str, "title": str, "fidelity": str, "axis": str, "rate": float, "status": str, "why": str,
    "p50": float, "p99": float, "steps": int, "memory": int, "offline": float, "estimated_error": float,
    "discretisation": float, "finest": float, "falling": str,
}  # fmt: skip
MEASURES = ("rms", "worst", "band")


def write(cells: Sequence[Cell], about: dict[str, Any], path: Path) -> None:
    """A line of provenance as JSON behind a `#`, then a row a cell: [s], [byte], errors over the peak of the truth."""
    names = [*PLAIN, "mostly", *(f"{q} {m}" for q in QUANTITIES for m in MEASURES)]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {json.dumps(about, ensure_ascii=False, default=str)}\n")
        rows = csv.DictWriter(file, names)
        rows.writeheader()
        for cell in cells:
            row: dict[str, Any] = {n: "" if getattr(cell, n) is None else getattr(cell, n) for n in PLAIN}
            errors = {f"{q} {m}": own[m] for q, own in cell.errors.items() for m in MEASURES}
            rows.writerow({**row, "mostly": mostly(cell), **errors})


def read(path: Path) -> tuple[list[Cell], dict[str, Any]]:
    """Cells and provenance. ArgumentError: the file is none of `write`."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            first = file.readline()
            about = json.loads(first.removeprefix("#"))
            return [_cell(row) for row in csv.DictReader(file)], about
    except (ValueError, KeyError, TypeError) as error:
        raise ArgumentError(f"{path}: not a table of `palpate bench accuracy` ({error})") from None


def _cell(row: dict[str, str]) -> Cell:
    plain = {name: kind(row[name]) if row[name] != "" or kind is str else None for name, kind in PLAIN.items()}
    errors = {q: {m: float(row[f"{q} {m}"]) for m in MEASURES} for q in QUANTITIES if row[f"{q} rms"] != ""}
    return Cell(**plain, errors=errors)  # type: ignore[arg-type]
