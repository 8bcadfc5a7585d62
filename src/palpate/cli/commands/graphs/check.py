"""`palpate check`: check a graph and report all its faults."""

from palpate.cli.terminal import options
from palpate.cli.terminal.output import console, print_json, say
from palpate.cli.terminal.run_options import RunOptions, takes_run

EXAMPLE = "palpate check kidney --scene frictionless"


@takes_run()
def check(
    chosen: RunOptions,
    place: options.PlaceOption = None,
    fused: options.Fused = False,
    as_json: options.Json = False,
) -> None:
    """Check a graph, its scene and its placement.

    All faults are reported at once. Exit code 2 if there are any. A line names the settings with which results jump
    when another setting changes a little, such as the counts of an encoder, and the switch that removes them.
    """
    from palpate.launch.load.checks.ideal import describe_jumps, jumps
    from palpate.launch.load.plan import check_stored

    run = chosen.launch(place, fused, silent=as_json)
    plan = run.plan()
    check_stored(plan)
    groups = run.placement(plan).groups
    edges = [edge for inputs in plan.edges.values() for edge in inputs]
    held = sum(edge.loop for edge in edges)
    if as_json:
        print_json({"ok": True, "nodes": len(plan.order), "observers": len(plan.observers),
                    "skipped": len(plan.skipped), "edges": len(edges), "loop_edges": held, "processes": len(groups),
                    "rate": plan.graph.rate, "notes": plan.graph.notes,
                    "jumps": [each.path for each in jumps(plan.graph.nodes[name] for name in plan.order)]})  # fmt: skip
        return
    from rich.text import Text

    counts = {"nodes": plan.order, "observers": plan.observers, "skipped": plan.skipped, "edges": edges}
    counted = ", ".join(f"{what} {len(things)}" for what, things in counts.items())
    text = f"  {counted} ({held} held), processes {len(groups)}, rate {plan.graph.rate:g} Hz"
    console(soft_wrap=True).print(Text.assemble(("ok", "green"), text))
    if text := describe_jumps(plan.graph, plan.order):
        say(f"no derivatives: {text}")
    for note in plan.graph.notes:
        say(note, "yellow", err=True)
