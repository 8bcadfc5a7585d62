"""`palpate new launch`: a launch file."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import tell

_LAUNCH = """\
# One run: palpate run {file}
graph: {graph}
# scene: frictionless                # in place of the graph's own
# place: two                         # processes; without it each node has one, `fused` means a single one
clock: simulated                     # or real
duration: 2 s
record: all                          # or sources (smaller, the rest is computed again), or NAME.mcap
# set: {{rate: 500}}                   # values as after `--set`, such as tissue.stiffness: 2e3
"""


def launch(
    name: Annotated[str, typer.Argument(help="Name of the file, without .yaml.")],
    graph: Annotated[str, typer.Option(help="A graph that ships, or the path of one.")] = "kidney",
    folder: Annotated[Path, typer.Option(help="Where to write.")] = Path(),
    as_json: Json = False,
) -> None:
    """Write a launch file: graph, clock, duration, recording and changed values of one run."""
    from palpate.engine.faults import Fault, GraphError
    from palpate.launch.load.launchfile import GRAPHS, find

    file, found = folder / f"{name}.yaml", find(graph).graph
    if file.exists():
        raise GraphError([Fault(f"{file} exists", "Choose another name, or remove the file.")])
    file.parent.mkdir(parents=True, exist_ok=True)
    named = found.stem if found.parent == GRAPHS else found
    file.write_text(_LAUNCH.format(file=file, graph=named), encoding="utf-8")
    if as_json:
        tell({"ok": True, "files": [str(file)]})
        return
    typer.echo(f"{file}\nRun: palpate run {file}")
