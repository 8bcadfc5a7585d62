"""`palpate plan`: what runs, what does not and why."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.costs import PROVED, price_row
from palpate.cli.terminal.output import console, print_json, table
from palpate.cli.terminal.run_options import RunOptions, takes_run

if TYPE_CHECKING:
    from palpate.engine.plan import Plan
    from palpate.launch.load.effect_costs import EffectCost
    from palpate.launch.load.placement import Placement

EXAMPLE = "palpate plan kidney --scene frictionless"


@takes_run()
def plan(
    chosen: RunOptions,
    place: options.PlaceOption = None,
    fused: options.Fused = False,
    ablate: Annotated[
        Path | None,
        typer.Option(help="A recorded touch: compute it again with each effect toggled, and show what changes."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Show what runs, what does not and why, and after a run the cost per effect.

    Times come from the newest recording of the graph below runs/, or that of --ablate. Without one, times are missing.
    """
    from palpate.launch.load.effect_costs import effect_costs
    from palpate.records.times import step_times

    if ablate is not None and chosen.organ is not None:
        raise typer.BadParameter("--ablate computes a recorded touch again, on its organ; leave out --organ")
    run = chosen.launch(place, fused, silent=as_json)
    planned = run.plan()
    times, source = step_times(planned, ablate)
    placement = run.placement(planned, times)
    items = effect_costs(planned, times)
    if ablate is not None:
        from palpate.launch.run.progress import steps
        from palpate.records.reader import Recording
        from palpate.studies import ablation

        title = f"plan: the touch again with each of {len(items)} effects toggled"
        with steps(title, len(items), silent=as_json) as done:
            ablation.ablate(Recording(ablate), items, chosen.sets or [], lambda name: done(f"{name} toggled"))
    if as_json:
        groups = [{"name": g.name, "nodes": g.nodes, "core": g.core, "priority": g.priority, "host": g.host,
                   "why": g.why}
                  for g in placement.groups]  # fmt: skip
        addition = {"times": times, "times_from": source and str(source), "costs": [asdict(item) for item in items],
                    "notes": planned.graph.notes}  # fmt: skip
        print_json(planned.to_spec() | {"groups": groups} | addition)
    else:
        _print(planned, placement, items, source)


def _print(planned: Plan, placement: Placement, items: list[EffectCost], source: Path | None) -> None:
    from rich.text import Text

    screen = console()
    # The nodes that run, with their inputs and processes, and those that do not.
    rows = []
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
        rows.append((Text("run", style="green"), name, use, wires, group.name + core))
    title = f"{planned.graph.path.name}, {planned.graph.rate:g} Hz"
    screen.print(table(("", "node", "class", "inputs (~ held)", "process"), rows, title=title, fixed=("node", "class")))
    for group in (group for group in placement.groups if group.why):  # of `--place auto`
        screen.print(f"process {group.name}: {group.why}")
    if planned.skipped:
        screen.print()
        word = Text("skip", style="yellow")
        screen.print(table(("", "", ""), ((word, name, reason) for name, reason in planned.skipped.items())))
    for note in planned.graph.notes:
        screen.print(f"\n{note}", style="yellow")
    if not items:
        return
    # The cost of each effect.
    timed = f"times of {source}" if source else "no times: no recording of this graph in runs/, palpate run makes one"
    proved = PROVED if any(item.proof for item in items) else ""
    screen.print()
    screen.print(table(
        ("", "effect", ">µs", "why"), map(price_row, items), title=f"cost per effect, µs per tick ({timed})",
        caption=f"µs: median step time of the nodes that run only for this effect{proved}",
    ))  # fmt: skip
