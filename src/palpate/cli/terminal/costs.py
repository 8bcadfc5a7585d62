"""The cost of an effect as a row of the table of `palpate plan`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text

    from palpate.launch.load.effect_costs import EffectCost

PROVED = (
    "; in blue: the whole tick, recomputed on this machine with and without the effect; it includes the time that "
    "other nodes spend on the effect"
)


def price_row(item: EffectCost) -> tuple[Text | str, ...]:
    """Whether an effect runs, its name, time per tick in µs, and why."""
    from rich.text import Text

    word = Text("on", style="green") if item.on else Text("off", style="yellow")
    price = "" if not item.nodes else "?" if item.price is None else f"{item.price * 1e6:.1f}"
    why = Text(item.rule)
    if item.nodes or item.fields:
        why.append(f"\nruns only for this effect: {', '.join([*item.nodes, *item.fields])}", style="dim")
    if item.proof:
        why.append(f"\n{item.proof}", style="cyan")
    return word, item.effect, price, why
