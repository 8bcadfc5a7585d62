"""`palpate tune`: the body and fidelity for a budget of time, or of error, on this machine."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import TROUBLE, Graph, Json, SceneOption, Sets, chosen, console, seconds, tell
from palpate.launch.commands.progress import steps

if TYPE_CHECKING:
    from palpate.studies.tune import Candidate, Goal


PER_TICK = 1e-3
"""[s] that a body takes for a tick of the touch, the reference beside it and the start included."""


def tune(
    graph: Graph,
    budget: Annotated[
        float | None, typer.Option(help="p99 of all steps of a tick: '0.5 ms'.", parser=seconds, metavar="TIME")
    ] = None,
    error: Annotated[
        str | None, typer.Option(help="rms over the touch, of the peak: '2 % force', or of indentation or shape.")
    ] = None,
    sets: Sets = None,
    scene: SceneOption = None,
    duration: Annotated[
        float | None, typer.Option(help="Of the touch that is tuned on.", parser=seconds, metavar="TIME")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Launch file to write; runs/GRAPH-tuned.yaml.")
    ] = None,
    as_json: Json = False,
) -> None:
    """The most accurate body that keeps a budget, or the cheapest that keeps an error, for this graph on this machine.

    Writes a launch file for `palpate run`, runs it, and tells what was promised and what came. Exit code 1 where
    nothing keeps what is asked for.
    """
    from palpate.studies.tune import (
        Candidate,
        Goal,
        TuneError,
        candidates,
        cause,
        claim,
        kept,
        measured,
        pick,
        read_error,
        reference,
        touched,
        write,
    )

    if budget is None and error is None:
        raise typer.BadParameter("expected --budget '0.5 ms', --error '2 % force', or both")
    share, quantity = read_error(error) if error is not None else (None, "force")
    goal = Goal(budget, share, quantity)
    launch = chosen(graph, sets, scene).but(duration=duration)
    if launch.duration is None:
        raise TuneError(f"{graph}: it runs without end; give the length of the touch: --duration '5 s'")
    wanted = candidates(launch.load())
    file = out or Path("runs", f"{(launch.path or launch.graph).stem}-tuned.yaml")
    title = f"tune: a touch of {launch.duration:g} s, then again with {len(wanted)} bodies"
    count, ticks = len(wanted) + 2, launch.duration * launch.load().rate
    with (
        tempfile.TemporaryDirectory() as folder,
        steps(title, count, silent=as_json, seconds=PER_TICK * ticks * count) as done,
    ):
        recording = touched(launch, Path(folder) / "touch.mcap")
        done("the touch")
        ranked: list[Candidate] = []
        base = reference(recording, wanted)
        claimed = claim(recording, base)
        for one in measured(recording, wanted, base, goal):
            ranked.append(one)
            done(one.title)
        best = pick(ranked, goal)
        came = None
        if best is not None:
            write(launch, best.overrides, _promise(best, goal), file)
            came = kept(launch, best, base, goal, Path(folder), lambda: done("a run of the choice"))
    why = cause(ranked, goal) if best is None else ""
    if as_json:
        _json(ranked, best, came, file, base, why)
    else:
        against = f"Errors are differences from {Candidate(base).title}, " + (
            f"what it is known to be off by itself added: {100 * claimed:.2g} %."
            if claimed
            else "of whose own error nothing is known."
        )
        _print(ranked, best, came, goal, file, against, why)
    if best is None:
        raise typer.Exit(TROUBLE)


def _promise(best: Candidate, goal: Goal) -> list[str]:
    return [
        f"Chosen by palpate tune: {goal.quantity} off by {100 * best.error:.2g} % of its peak (rms),",
        f"a tick {1e6 * best.p50:.0f} us p50, {1e6 * best.p99:.0f} us p99, on the machine that it was tuned on.",
    ]


def _json(
    ranked: list[Candidate],
    best: Candidate | None,
    came: Candidate | None,
    file: Path,
    base: dict[str, object],
    why: str,
) -> None:
    def data(one: Candidate) -> dict[str, object]:
        times = {} if one.why else {"error": one.error, "p50_s": one.p50, "p99_s": one.p99}
        return {"set": one.overrides, **times, **({"why": one.why} if one.why else {})}

    tell({"ok": best is not None, "file": str(file) if best else None, "reference": base,
          "promised": best and data(best), "came": came and data(came), **({"why": why} if why else {}),
          "candidates": [data(one) for one in ranked]})  # fmt: skip


def _print(
    ranked: list[Candidate],
    best: Candidate | None,
    came: Candidate | None,
    goal: Goal,
    file: Path,
    against: str,
    why: str,
) -> None:
    from rich.table import Table

    out = console()
    shown = Table(box=None, header_style="bold", pad_edge=False)
    for title in ("", f"{goal.quantity} off by\nrms %", "tick [us]\np50", "\np99"):
        shown.add_column(title, justify="left" if not title else "right")
    for one in sorted((c for c in ranked if not c.why), key=lambda c: c.error):
        style = "bold" if one is best else None
        shown.add_row(one.title, f"{100 * one.error:.3g}", f"{1e6 * one.p50:.0f}", f"{1e6 * one.p99:.0f}", style=style)
    out.print(shown)
    for reason in dict.fromkeys(one.why for one in ranked if one.why):
        titles = "; ".join(one.title for one in ranked if one.why == reason)
        out.print(f"left out {titles}: {reason}", markup=False, style="dim")
    out.print(against, markup=False)
    if best is None:
        out.print(f"Nothing keeps {_asked(goal)} here. {why}".rstrip(), style="yellow", markup=False)
        return
    assert came is not None
    for word, one in (("promised", best), ("came", came)):
        times = f"{1e6 * one.p50:.0f} us p50, {1e6 * one.p99:.0f} us p99"
        out.print(f"{word:9} {goal.quantity} off by {100 * one.error:.3g} %, a tick {times}", markup=False)
    missed = (goal.budget is not None and came.p99 > goal.budget) or (
        goal.error is not None and came.error > goal.error
    )
    if missed:
        out.print(
            "The run did not keep it: the machine was busier, or the touch differs under this body.", style="yellow"
        )
    out.print(f"written   {file}: palpate run {file}", markup=False)


def _asked(goal: Goal) -> str:
    asked = [] if goal.budget is None else [f"{1e3 * goal.budget:g} ms at p99"]
    asked += [] if goal.error is None else [f"{100 * goal.error:g} % of the {goal.quantity}"]
    return " and ".join(asked)
