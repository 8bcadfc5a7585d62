"""The tables of `palpate plan`."""

from pathlib import Path

from rich.table import Table
from rich.text import Text

from palpate.cli.terminal.output import table
from palpate.engine.plan import Plan
from palpate.launch.load.effect_costs import EffectCost
from palpate.launch.load.placement import Placement

PROVED = (
    "; in blue: the whole tick, recomputed on this machine with and without the effect; it includes the time that "
    "other nodes spend on the effect"
)


def running(planned: Plan, placement: Placement) -> Table:
    """The nodes that run: their order, inputs and processes."""
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
    return table(("", "node", "class", "inputs (~ held)", "process"), rows, title=title, fixed=("node", "class"))


def skipped(planned: Plan) -> Table:
    word = Text("skip", style="yellow")
    return table(("", "", ""), ((word, name, reason) for name, reason in planned.skipped.items()))


def costs(items: list[EffectCost], source: Path | None) -> Table:
    """The cost of each effect; source: the recording that the times are from."""
    timed = f"times of {source}" if source else "no times yet: run the graph first"
    proved = PROVED if any(item.proof for item in items) else ""
    return table(
        ("", "effect", ">µs", "why"), map(_priced, items), title=f"cost per effect, µs per tick ({timed})",
        caption=f"µs: median step time of the nodes that run only for this effect{proved}",
    )  # fmt: skip


def _priced(item: EffectCost) -> tuple[Text | str, ...]:
    word = Text("on", style="green") if item.on else Text("off", style="yellow")
    price = "" if not item.nodes else "?" if item.price is None else f"{item.price * 1e6:.1f}"
    why = Text(item.rule)
    if item.nodes or item.fields:
        why.append(f"\nruns only for this effect: {', '.join([*item.nodes, *item.fields])}", style="dim")
    if item.proof:
        why.append(f"\n{item.proof}", style="cyan")
    return word, item.effect, price, why
