"""A run of the accuracy bench written down: table, pictures where matplotlib is there, page; and what it was run on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from palpate.engine.provenance import machine
from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.order import studies
from palpate.studies.accuracy.output import page, table
from palpate.studies.accuracy.output.pareto import summaries
from palpate.studies.peers import calculix


def about() -> dict[str, Any]:
    """Versions, machine and commit."""
    versions = machine("numpy", "scipy", "numba", "felupe", "mujoco")
    return {**versions, "calculix": calculix.version() or "not installed", "seeds": "none, nothing here is random"}


def written(cells: list[Cell], told: dict[str, Any], folder: Path) -> dict[str, Path]:
    """The files by what they are."""
    table.write(cells, told, folder / "accuracy.csv")
    drawn = _drawn(cells, folder)
    page.write(cells, told, drawn, folder / "accuracy.md")
    return {"page": folder / "accuracy.md", "table": folder / "accuracy.csv", **drawn}


def _drawn(cells: list[Cell], folder: Path) -> dict[str, Path]:
    """The pictures; none where matplotlib is missing."""
    from palpate.studies.accuracy.output.pictures import convergence, overview, touch_picture

    drawn: dict[str, Path] = {}
    try:
        for touch in dict.fromkeys(c.touch for c in cells):
            drawn[touch] = folder / f"{touch}.png"
            touch_picture([c for c in cells if c.touch == touch], drawn[touch])
        drawn["overview"] = folder / "overview.png"
        overview(summaries(cells), cells, drawn["overview"])
        if orders := studies(cells):
            drawn["convergence"] = folder / "convergence.png"
            convergence(orders, drawn["convergence"])
    except ImportError:
        return {}
    return drawn
