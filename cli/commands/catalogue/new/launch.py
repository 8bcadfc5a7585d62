"""`palpate new launch`: a launch file."""

from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import tell
from palpate.cli.terminal.templates import HERE, Folder, Force, write

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
    out: Folder = HERE,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a launch file: graph, clock, duration, recording and changed values of one run."""
    from palpate.launch.load.launchfile import GRAPHS, find

    found = find(graph).graph
    named = found.stem if found.parent == GRAPHS else found
    (file,) = write({f"{name}.yaml": _LAUNCH.format(file=out / f"{name}.yaml", graph=named)}, out, force)
    if as_json:
        tell({"ok": True, "files": [str(file)]})
        return
    typer.echo(f"{file}\nRun: palpate run {file}")
