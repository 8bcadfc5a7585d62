"""`palpate plan`: what runs, what does not and why; also as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from palpate.launch.commands.common import Fused, Graph, Json, PlaceOption, SceneOption, Sets, chosen, console, tell

if TYPE_CHECKING:
    from palpate.launch.loading.placement import Placement
    from palpate.launch.loading.plan import Plan

MERMAID = "mermaid"
_PICTURE = ".mmd"


class PlanCommand(TyperCommand):
    """Lets `--draw` stand alone: then it means Mermaid text on standard output."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        given = list(args)
        for at in range(len(given) - 1, -1, -1):
            following = given[at + 1 : at + 2]
            if given[at] == "--draw" and not (following and following[0].endswith((_PICTURE, MERMAID))):
                given.insert(at + 1, MERMAID)
        return super().parse_args(ctx, given)


def plan(
    graph: Graph,
    sets: Sets = None,
    scene: SceneOption = None,
    place: PlaceOption = None,
    fused: Fused = False,
    draw: Annotated[
        str | None,
        typer.Option(help="Print the graph as Mermaid text, or write it to FILE.mmd.", metavar="[FILE]"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what of a graph runs, in which order, and why the rest does not."""
    run = chosen(graph, sets, scene, place, fused)
    found = run.plan()
    placement = run.placement(found)
    if draw is not None:
        _draw(found, draw)
    elif as_json:
        groups = [{"name": g.name, "nodes": g.nodes, "core": g.core, "priority": g.priority, "host": g.host}
                  for g in placement.groups]  # fmt: skip
        tell(found.to_spec() | {"groups": groups})
    else:
        out = console()
        out.print(_running(found, placement))
        if found.skipped:
            out.print()
            out.print(_skipped(found))


def _draw(found: Plan, draw: str) -> None:
    from palpate.launch.loading.draw import mermaid

    if draw == MERMAID:
        typer.echo(mermaid(found), nl=False)
    elif draw.endswith(_PICTURE):
        Path(draw).write_text(mermaid(found), encoding="utf-8")
        typer.echo(draw)
    else:
        raise typer.BadParameter(f"found {draw!r}, expected a file name ending in .mmd", param_hint="--draw")


def _running(found: Plan, placement: Placement) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=f"{found.graph.path.name}, {found.graph.rate:g} Hz", title_justify="left", box=None, pad_edge=False
    )
    for column in ("", "node", "class", "inputs (~ held)", "process"):
        table.add_column(column, overflow="fold", no_wrap=column in ("node", "class"))
    for name in (*found.order, *found.observers):
        spec = found.graph.nodes[name]
        if name in found.observers:
            count = len(found.observers[name])
            wires = "all streams" if spec.listen is None else f"{count} stream{'s' * (count != 1)}"
        else:
            wires = ", ".join(f"{'~' * edge.loop}{edge.stream}" for edge in found.edges[name])
        group = placement.group_of(name)
        core = "" if group.core is None else f" (core {', '.join(map(str, group.core))})"
        use = spec.use if spec.every == 1 else f"{spec.use}, every {spec.every}"
        table.add_row(Text("run", style="green"), *map(Text, (name, use, wires, group.name + core)))
    return table


def _skipped(found: Plan) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, show_header=False)
    for name, reason in found.skipped.items():
        table.add_row(Text("skip", style="yellow"), Text(name), Text(reason))
    return table
