"""`palpate rates`: how seldom each effect may run for a stated error."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.launch.commands.common import TROUBLE, Graph, Json, SceneOption, Sets, chosen, console, seconds, tell
from palpate.launch.commands.progress import steps

if TYPE_CHECKING:
    from palpate.launch.recording.compare import Variant
    from palpate.studies.rates import Rate


PER_TICK = 3e-3
"""[s] that an effect takes for a tick of the touch: it is computed again at several rates side by side."""


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
    from palpate.studies import rates as measure
    from palpate.studies.tune import touched, write

    share = measure.read_error(error)
    launch = chosen(graph, sets, scene).but(duration=duration)
    if launch.duration is None:
        raise measure.RateError(f"{graph}: it runs without end; give the length of the touch: --duration '5 s'")
    found = measure.effects_of(launch.plan())
    file = out or Path("runs", f"{(launch.path or launch.graph).stem}-rates.yaml")
    title = f"rates: a touch of {launch.duration:g} s, then again at other rates of {len(found)} effects"
    count, ticks = len(found) + 3, launch.duration * launch.load().rate
    with (
        tempfile.TemporaryDirectory() as folder,
        steps(title, count, silent=as_json, seconds=PER_TICK * ticks * count) as show,
    ):
        recording = touched(launch, Path(folder) / "touch.mcap")
        show("the touch")
        single = list(measure.chosen(recording, share, show))
        show("all together")
        picked, *promised = measure.together(recording, single, share)
        while True:  # in a run of it the hand reacts to the force, and the touch becomes another one
            show("a run of it")
            again = touched(launch.but(overrides=[rate.override() for rate in picked]), Path(folder) / "slow.mcap")
            came = measure.came(again, picked)
            kept = measure.force_error(came[1]) <= share
            finer = None if kept else measure.oftener(picked)
            if finer is None:
                break
            picked, *promised = measure.together(recording, finer, share)
    overrides = {f"{rate.node}.every": rate.every for rate in picked}
    if kept:
        write(launch, overrides, _promise(share, came[1]), file)
    if as_json:
        tell({"ok": kept, "file": str(file) if kept else None, "error": share, "set": overrides,
              "effects": [_data(rate) for rate in picked],
              "promised": _times(*promised), "came": _times(*came)})  # fmt: skip
    else:
        _print(picked, {"promised": promised, "came": came}, kept)
        if kept:
            console().print(f"written   {file}: palpate run {file}", markup=False)
    if not kept:
        raise typer.Exit(TROUBLE)


def _promise(share: float, variant: Variant) -> list[str]:
    from palpate.studies.rates import force_error

    return [
        f"Chosen by palpate rates: each effect as seldom as an error of {100 * share:.2g} % allows;",
        f"the force is off by {100 * force_error(variant):.2g} % of its peak (rms) in a run of it.",
    ]


def _data(rate: Rate) -> dict[str, Any]:
    constant = None if rate.idle else rate.constant
    return {"node": rate.node, "effect": rate.effect, "every": rate.every, "before": rate.before,
            "time_constant_s": constant, "error": rate.own, "force_error": rate.force}  # fmt: skip


def _times(base: Variant, variant: Variant) -> dict[str, float]:
    from palpate.studies.rates import force_error, mean

    return {"force_error": force_error(variant), "tick_s": mean(variant), "tick_at_full_rates_s": mean(base)}


def _print(picked: list[Rate], runs: dict[str, Any], kept: bool) -> None:
    from rich.table import Table

    out = console()
    shown = Table(box=None, header_style="bold", pad_edge=False)
    for title in ("", "effect", "time\nconstant", "every", "\nnow", "off by, rms %\nits output", "\nforce"):
        shown.add_column(title, justify="left" if title in ("", "effect") else "right")
    for rate in picked:
        constant = "idle" if rate.idle else f"{1e3 * rate.constant:.3g} ms"
        errors = ("", "") if rate.idle else (_percent(rate.own), _percent(rate.force) if rate.felt else "")
        shown.add_row(rate.node, rate.effect, constant, str(rate.every), str(rate.before), *errors)
    out.print(shown)
    if any(rate.idle for rate in picked):
        out.print(
            "idle: nothing of it changes on this touch, and its rate is left; another touch may tell", style="dim"
        )
    for word, (base, variant) in runs.items():
        told = _times(base, variant)
        out.print(
            f"{word:9} force off by {_percent(told['force_error'])} %, a tick {1e6 * told['tick_s']:.0f} us in the "
            f"mean, where all effects at each tick take {1e6 * told['tick_at_full_rates_s']:.0f} us",
            markup=False,
        )
    if not kept:
        out.print(
            "No run kept the error: the hand reacts to the force, and the touch became another one. Nothing "
            "is written. Take a larger --error.",
            style="yellow",
        )


def _percent(share: float) -> str:
    return f"{100 * share:.2g}" if share > 1e-9 else "0"
