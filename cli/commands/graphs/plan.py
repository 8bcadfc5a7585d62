"""`palpate plan`: what runs, what does not and why."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Fused, Graph, Json, PlaceOption, SceneOption, Sets, chosen
from palpate.cli.terminal.output import console, print_json
from palpate.launch.run.progress import steps

EXAMPLE = "palpate plan kidney --scene frictionless"


def plan(
    graph: Graph,
    sets: Sets = None,
    scene: SceneOption = None,
    place: PlaceOption = None,
    fused: Fused = False,
    ablate: Annotated[
        Path | None,
        typer.Option(help="A recorded touch: compute it again with each effect toggled, and show what changes."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what runs, what does not and why, and the cost per effect.

    Times come from the newest recording of the graph below runs/, or from the one given to --ablate.
    """
    from palpate.launch.load.effect_costs import effect_costs
    from palpate.records.times import step_times

    run = chosen(graph, sets, scene, place, fused)
    planned = run.plan()
    times, source = step_times(planned, ablate)
    placement = run.placement(planned, times)
    items = effect_costs(planned, times)
    if ablate is not None:
        from palpate.records.reader import Recording
        from palpate.studies import ablation

        title = f"plan: the touch again with each of {len(items)} effects toggled"
        with steps(title, len(items), silent=as_json) as done:
            ablation.ablate(Recording(ablate), items, sets or [], lambda name: done(f"{name} toggled"))
    if as_json:
        groups = [{"name": g.name, "nodes": g.nodes, "core": g.core, "priority": g.priority, "host": g.host,
                   "why": g.why}
                  for g in placement.groups]  # fmt: skip
        addition = {"times": times, "times_from": source and str(source), "costs": [asdict(item) for item in items],
                    "notes": planned.graph.notes}  # fmt: skip
        print_json(planned.to_spec() | {"groups": groups} | addition)
    else:
        from palpate.cli.terminal import plan_tables

        screen = console()
        screen.print(plan_tables.running(planned, placement))
        for group in (group for group in placement.groups if group.why):  # of `--place auto`
            screen.print(f"process {group.name}: {group.why}")
        if planned.skipped:
            screen.print()
            screen.print(plan_tables.skipped(planned))
        for note in planned.graph.notes:
            screen.print(f"\n{note}", style="yellow")
        if items:
            screen.print()
            screen.print(plan_tables.costs(items, source))
