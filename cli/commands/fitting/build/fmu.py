"""`palpate build fmu`: a graph as a unit for co-simulation."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Graph, Json, Sets
from palpate.cli.terminal.output import say, tell

EXAMPLE = "palpate build fmu kidney -o kidney.fmu"


def fmu(
    graph: Graph,
    sets: Sets = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="File to write; default GRAPH.fmu.")] = None,
    as_json: Json = False,
) -> None:
    """Write a graph as a unit for co-simulation (FMI 3.0)."""
    from palpate.launch.fmu import export_fmu

    unit = export_fmu(graph, out, sets or ())
    if as_json:
        tell({"ok": True, "files": [str(unit)]})
    else:
        say(f"{unit}: {unit.stat().st_size / 1e6:.2f} MB", wrap=True)
