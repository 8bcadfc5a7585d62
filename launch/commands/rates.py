"""`palpate rates`: how seldom each effect may run for a stated error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.launch.commands.common import TROUBLE, Graph, Json, SceneOption, Sets, chosen, console, seconds, tell
from palpate.launch.commands.progress import steps

if TYPE_CHECKING:
    from palpate.studies.rates import Rate
    from palpate.studies.search import Found, Trial

PER_TICK = 3e-3
"""[s] that an effect takes for a tick of the touch: it is computed again at all rates side by side."""


def rates(
    graph: Graph,
    error: Annotated[
        str, typer.Option(help="rms over the touch, of the peak: of each effect's own output, and of the force.")
    ] = "1 %",
    sets: Sets = None,
    scene: SceneOption = None,
    duration: Annotated[
        float | None, typer.Option(help="Of the touch that is measured on.", parser=seconds, metavar="TIME")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Launch file to write; runs/GRAPH-rates.yaml.")
    ] = None,
    as_json: Json = False,
) -> None:
    """The lowest rate of each effect that keeps an error, from its own time constant, for this graph.

    Runs the graph at these rates, more often until the run keeps the error, and writes a launch file for `palpate run`
    with what was measured. Nothing is written, and the exit code is 1, where no run keeps it.
    """
    from palpate.studies import rates as study
    from palpate.studies.search import read_error

    share, _ = read_error(error)
    launch = chosen(graph, sets, scene).but(duration=duration)
    planned = launch.plan()
    effects, length = len(study.effects_of(planned)), launch.duration or 0.0
    file = out or Path("runs", f"{(launch.path or launch.graph).stem}-rates.yaml")
    title, count = f"rates: a touch of {length:g} s, then again at other rates of {effects} effects", effects + 2
    with steps(title, count, silent=as_json, seconds=PER_TICK * length * planned.graph.rate * count) as done:
        found = study.rates(launch, share, file, done)
    if as_json:
        assert found.promised is not None and found.came is not None
        tell({"ok": found.kept, "file": str(file) if found.kept else None, "error": share,
              "set": found.promised.overrides, "effects": [_data(rate) for rate in found.tried],
              "promised": _times(found.promised), "came": _times(found.came)})  # fmt: skip
    else:
        _print(found, file)
    if not found.kept:
        raise typer.Exit(TROUBLE)


def _data(rate: Rate) -> dict[str, Any]:
    constant = None if rate.idle else rate.constant
    return {"node": rate.node, "effect": rate.effect, "every": rate.every, "before": rate.before,
            "time_constant_s": constant, "error": rate.own, "force_error": rate.force}  # fmt: skip


def _times(one: Trial) -> dict[str, float]:
    return {"force_error": one.error, "tick_s": one.mean, "tick_at_full_rates_s": one.reference}


def _print(found: Found, file: Path) -> None:
    from rich.table import Table

    out = console()
    shown = Table(box=None, header_style="bold", pad_edge=False)
    for title in ("", "effect", "time\nconstant", "every", "\nnow", "off by, rms %\nits output", "\nforce"):
        shown.add_column(title, justify="left" if title in ("", "effect") else "right")
    for rate in found.tried:
        constant = "idle" if rate.idle else f"{1e3 * rate.constant:.3g} ms"
        errors = ("", "") if rate.idle else (_percent(rate.own), _percent(rate.force) if rate.felt else "")
        shown.add_row(rate.node, rate.effect, constant, str(rate.every), str(rate.before), *errors)
    out.print(shown)
    if any(rate.idle for rate in found.tried):
        out.print(
            "idle: nothing of it changes on this touch, and its rate is left; another touch may tell", style="dim"
        )
    for word, one in (("promised", found.promised), ("came", found.came)):
        assert one is not None
        out.print(
            f"{word:9} force off by {_percent(one.error)} %, a tick {1e6 * one.mean:.0f} us in the "
            f"mean, where all effects at each tick take {1e6 * one.reference:.0f} us",
            markup=False,
        )
    if found.kept:
        out.print(f"written   {file}: palpate run {file}", markup=False)
    else:
        out.print(
            "No run kept the error: the hand reacts to the force, and the touch became another one. Nothing "
            "is written. Take a larger --error.",
            style="yellow",
        )


def _percent(share: float) -> str:
    return f"{100 * share:.2g}" if share > 1e-9 else "0"
