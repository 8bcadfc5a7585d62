"""`palpate tune`: the tissue model and fidelity for a time or error budget on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.output import console, print_json, say, table
from palpate.cli.terminal.run_options import RunOptions, takes_run
from palpate.launch.run.progress import steps
from palpate.physics.errors import TROUBLE

if TYPE_CHECKING:
    from palpate.studies.search import Evaluation
    from palpate.studies.tune import Goal, TuneResult

EXAMPLE = "palpate tune kidney --budget '0.5 ms'"
PER_TICK = 1e-3  # [s] computing time per tick of the touch for one body, including the reference and the start


def _budget(text: str) -> float:
    """A time in s. BadParameter: not a time, or without a unit: the times of a tick are below 1 ms."""
    try:
        float(text)
    except ValueError:
        return options.seconds(text)
    raise typer.BadParameter(f"found {text!r} without a unit; expected a time such as '{text} ms' or '{text} s'")


@takes_run()
def tune(
    chosen: RunOptions,
    budget: Annotated[
        float | None,
        typer.Option(help="Processor time per tick, all nodes, p99: '0.5 ms'.", parser=_budget, metavar="TIME"),
    ] = None,
    error: Annotated[
        str | None, typer.Option(help="Allowed RMS error, % of peak: '2 % force'; also indentation or shape.")
    ] = None,
    duration: options.Duration = None,
    out: Annotated[Path | None, options.out_option("Launch file to write; default runs/GRAPH-tuned.yaml.")] = None,
    as_json: options.Json = False,
) -> None:
    """Find the best tissue model for a time or error budget.

    Finds the most accurate model within a time budget, or the fastest within an error, on this machine. Writes a launch
    file for `palpate run`, runs it, and prints predicted and measured figures. Exit code 1 if no model qualifies.
    """
    from palpate.studies import tune as study
    from palpate.studies.search import read_error

    if budget is None and error is None:
        raise typer.BadParameter("expected --budget '0.5 ms', --error '2 % force', or both")
    goal = study.Goal(budget, *(read_error(error, study.QUANTITIES) if error is not None else (None, "force")))
    launch = chosen.launch(silent=as_json).but(duration=duration)
    file = options.launch_file(launch, out, "tuned")
    loaded = launch.load()
    bodies, length = len(study.candidates(loaded)), launch.duration or 0.0
    title, count = f"tune: a touch of {length:g} s, then again with {bodies} bodies", bodies + 2
    with steps(title, count, silent=as_json, seconds=PER_TICK * length * loaded.rate * count) as done:
        tuned = study.tune(launch, goal, file, done)
    if as_json:
        data: dict[str, object] = {"ok": tuned.predicted is not None, "file": str(file) if tuned.predicted else None,
                "reference": tuned.reference.overrides, "predicted": tuned.predicted and _data(tuned.predicted),
                "measured": tuned.measured and _data(tuned.measured)}  # fmt: skip
        print_json(
            data | ({"why": tuned.why} if tuned.why else {}) | {"candidates": [_data(one) for one in tuned.tried]}
        )
    else:
        _print(tuned, goal, file)
    if tuned.predicted is None:
        raise typer.Exit(TROUBLE)


def _data(one: Evaluation) -> dict[str, object]:
    if one.why:
        return {"set": one.overrides, "why": one.why}
    wall = {"wall_p50_s": one.wall[0], "wall_p99_s": one.wall[1]}
    return {"set": one.overrides, "error": one.error, "p50_s": one.p50, "p99_s": one.p99, **wall}


def _print(tuned: TuneResult, goal: Goal, file: Path) -> None:
    from palpate.studies.tune import times, title

    found = sorted((one for one in tuned.tried if not one.why), key=lambda one: one.error)
    rows = [
        (title(one), f"{100 * one.error:.3g}", *(f"{1e6 * time:.0f}" for time in (one.p50, one.p99, *one.wall)))
        for one in found
    ]
    predicted = [k for k, one in enumerate(found) if one is tuned.predicted]
    priced = (">processor time\nof a tick [us], p50", ">\np99", ">by the clock\n[us], p50", ">\np99")
    heads = ("", f">{goal.quantity} error\nRMS %", *priced)
    console().print(table(heads, rows, bold=predicted))
    for reason in dict.fromkeys(one.why for one in tuned.tried if one.why):
        titles = "; ".join(title(one) for one in tuned.tried if one.why == reason)
        say(f"left out {titles}: {reason}", "dim", wrap=True)
    known = "whose error is unknown."
    if tuned.estimated_error:
        known = f"plus the known error of that reference: {100 * tuned.estimated_error:.2g} %."
    say(f"Errors are differences from {title(tuned.reference)}, {known}", wrap=True)
    here = "They apply to the touch of this graph; `palpate bench accuracy` uses other test cases, with other errors."
    say(here, "dim", wrap=True)
    if tuned.predicted is None or tuned.measured is None:
        say(f"No model meets {goal} on this machine. {tuned.why}".rstrip(), "yellow", wrap=True)
        return
    for word, one in (("predicted", tuned.predicted), ("measured", tuned.measured)):
        say(f"{word:9} {goal.quantity} error {100 * one.error:.3g} % of peak (RMS), tick {times(one)}", wrap=True)
    if not tuned.met:
        why = "The run missed the goal: the touch changes with this model."
        say(why, "yellow", wrap=True)
    say(f"written   {file}: palpate run {file}", wrap=True)
