"""`palpate plan`: what runs, what does not and why; also as a picture."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from palpate.launch.commands.common import Fused, Graph, Json, PlaceOption, SceneOption, Sets, chosen, console, tell
from palpate.launch.commands.progress import steps

if TYPE_CHECKING:
    from palpate.engine.plan import Plan
    from palpate.launch.load.bill import EffectCost
    from palpate.launch.load.placement import Placement

MERMAID = "mermaid"
_PICTURE = ".mmd"
NEWEST = 3  # recordings that are looked through for the times of a graph

PROVED = (
    "; in blue: the whole tick, computed again on this machine with and without the effect; it includes the time that "
    "other nodes spend on it"
)


class Command(TyperCommand):
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
    ablate: Annotated[
        Path | None,
        typer.Option(help="A recorded touch: compute it again with each effect toggled, and show what changes."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show which nodes run, in which order, why the others do not, and the cost per effect.

    Times come from the newest recording of the graph below runs/, or from the one given to --ablate.
    """
    from palpate.launch.load.bill import bill

    run = chosen(graph, sets, scene, place, fused)
    planned = run.plan()
    placement = run.placement(planned)
    times, source = _times(planned, ablate)
    items = bill(planned, times)
    if ablate is not None:
        _prove(ablate, items, sets or [], as_json)
    if draw is not None:
        _draw(planned, draw, times)
    elif as_json:
        groups = [{"name": g.name, "nodes": g.nodes, "core": g.core, "priority": g.priority, "host": g.host}
                  for g in placement.groups]  # fmt: skip
        addition = {"times": times, "times_from": source and str(source), "costs": [asdict(item) for item in items],
                    "notes": planned.graph.notes}  # fmt: skip
        tell(planned.to_spec() | {"groups": groups} | addition)
    else:
        out = console()
        out.print(_running(planned, placement))
        if planned.skipped:
            out.print()
            out.print(_skipped(planned))
        for note in planned.graph.notes:
            out.print(f"\n{note}", style="yellow", markup=False)
        if items:
            out.print()
            out.print(_bill(items, source))


def _times(planned: Plan, given: Path | None) -> tuple[dict[str, float], Path | None]:
    """Median duration [s] of a step of each node, and the recording that says so: each is read whole, so that only the
    newest few with the graph's name are tried."""
    from palpate.records.reader import Recording
    from palpate.records.stored import RecordingError

    named = Path("runs").glob(f"*/{planned.graph.path.stem}.mcap")
    newest = sorted(named, key=lambda file: -file.stat().st_mtime)
    for file in [given] if given else newest[:NEWEST]:
        try:
            recording = Recording(file)
        except RecordingError:
            if given:
                raise
            continue
        if recording.times and (given or Path(recording.about["plan"]["path"]).name == planned.graph.path.name):
            return {name: quantiles["median"] for name, quantiles in recording.times.items()}, file
    return {}, None


def _prove(file: Path, items: list[EffectCost], sets: list[str], silent: bool) -> None:
    from palpate.records.reader import Recording
    from palpate.studies.prove import prove

    with steps(f"plan: the touch again with each of {len(items)} effects toggled", len(items), silent=silent) as done:
        prove(Recording(file), items, sets, lambda name: done(f"{name} toggled"))


def _bill(items: list[EffectCost], source: Path | None) -> Any:
    from rich.table import Table
    from rich.text import Text

    timed = f"times of {source}" if source else "no times yet: run the graph first"
    caption = "µs: median step time of the nodes that run only for this effect"
    if any(item.proof for item in items):
        caption += PROVED
    table = Table(title=f"cost per effect, µs per tick ({timed})", title_justify="left", box=None, pad_edge=False,
                  caption=caption, caption_justify="left")  # fmt: skip
    for column, justify in (("", "left"), ("effect", "left"), ("µs", "right"), ("why", "left")):
        table.add_column(column, overflow="fold", justify=justify)  # type: ignore[arg-type]
    for item in items:
        word = Text("on", style="green") if item.on else Text("off", style="yellow")
        price = "" if not item.nodes else "?" if item.price is None else f"{item.price * 1e6:.1f}"
        why = Text(item.rule)
        if item.nodes or item.fields:
            why.append(f"\nruns only for this effect: {', '.join([*item.nodes, *item.fields])}", style="dim")
        if item.proof:
            why.append(f"\n{item.proof}", style="cyan")
        table.add_row(word, Text(item.effect), price, why)
    return table


def _draw(planned: Plan, draw: str, times: dict[str, float]) -> None:
    from palpate.launch.load.draw import mermaid

    if draw == MERMAID:
        typer.echo(mermaid(planned, times), nl=False)
    elif draw.endswith(_PICTURE):
        Path(draw).write_text(mermaid(planned, times), encoding="utf-8")
        typer.echo(draw)
    else:
        raise typer.BadParameter(f"found {draw!r}, expected a file name ending in .mmd", param_hint="--draw")


def _running(planned: Plan, placement: Placement) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=f"{planned.graph.path.name}, {planned.graph.rate:g} Hz", title_justify="left", box=None, pad_edge=False
    )
    for column in ("", "node", "class", "inputs (~ held)", "process"):
        table.add_column(column, overflow="fold", no_wrap=column in ("node", "class"))
    for name in (*planned.order, *planned.observers):
        spec = planned.graph.nodes[name]
        if name in planned.observers:
            count = len(planned.observers[name])
            wires = "all streams" if spec.listen is None else f"{count} stream{'s' * (count != 1)}"
        else:
            wires = ", ".join(f"{'~' * edge.loop}{edge.stream}" for edge in planned.edges[name])
        group = placement.group_of(name)
        core = "" if group.core is None else f" (core {', '.join(map(str, group.core))})"
        use = spec.use if spec.every == 1 else f"{spec.use}, every {spec.every}"
        table.add_row(Text("run", style="green"), *map(Text, (name, use, wires, group.name + core)))
    return table


def _skipped(planned: Plan) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, show_header=False)
    for name, reason in planned.skipped.items():
        table.add_row(Text("skip", style="yellow"), Text(name), Text(reason))
    return table
