"""The results that ship: cells of one run of the benchmark, from which its picture is redrawn in seconds."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from palpate.physics.archive import replace_text
from palpate.studies.accuracy.cells import Cell

RESULTS = Path(__file__).parents[1] / "references" / "results.json"
QUANTITY = "force"
"""The only quantity whose errors are stored; others are in the table that the benchmark writes."""


def save(cells: Sequence[Cell], about: dict[str, Any], path: Path = RESULTS) -> None:
    """Write cells, one per line, and the provenance. Numbers have 4 significant digits."""
    rows = []
    for cell in cells:
        row = asdict(cell)
        del row["kept"]
        row["errors"] = {QUANTITY: {k: _short(v) for k, v in row["errors"][QUANTITY].items()}}
        rows.append(row | {k: _short(row[k]) for k in ("p50", "p99", "offline")})
    lines = ",\n".join(json.dumps(row) for row in rows)
    replace_text(path, f'{{"about": {json.dumps(about, default=str)},\n"cells": [\n{lines}\n]}}\n')


def load(path: Path = RESULTS) -> tuple[list[Cell], dict[str, Any]]:
    """The cells and the provenance."""
    data = json.loads(path.read_text(encoding="utf-8"))
    return [Cell(**row) for row in data["cells"]], data["about"]


def _short(value: float) -> float:
    return float(f"{value:.4g}")
