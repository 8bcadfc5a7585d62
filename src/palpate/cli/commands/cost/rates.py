"""`palpate rates`: the lowest update rate of each effect for a given error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.output import console, print_json, say, table
from palpate.cli.terminal.run_options import RunOptions, takes_run
from palpate.launch.run.progress import steps
from palpate.physics.errors import TROUBLE

if TYPE_CHECKING:
    from palpate.studies.rates import Rate, RatesResult
    from palpate.studies.search import Evaluation

EXAMPLE = "palpate rates kidney --error '1 %'"
PER_TICK = 2e-3  # [s] computing time per tick of a run and its replay at two rates


@takes_run()
def rates(
    chosen: RunOptions,
    error: Annotated[
        str, typer.Option(help="Allowed RMS error, % of peak, of each effect's output and of the force.")
    ] = "1 %",
    duration: options.Duration = None,
    speeds: Annotated[
        str,
        typer.Option(help="Speeds of the simulated hand, as multiples of the graph's speed; the worst case counts."),
    ] = "0.5, 1, 2",
    out: Annotated[Path | None, options.out_option("Launch file to write; default runs/GRAPH-rates.yaml.")] = None,
    as_json: options.Json = False,
) -> None:
    """Find the lowest update rate of each effect for a given error.

    The search starts at the time constant of each effect, with the hand at several speeds and on other motions. Then
    the graph runs at these speeds and on motions outside the search; the rates are raised until the error is within the
    limit, and a launch file is written. If no rates meet the limit, nothing is written and the exit code is 1.
    """
    from palpate.studies import rates as study
    from palpate.studies.motions import at_speeds, peak_speeds
    from palpate.studies.search import read_error

    share, _ = read_error(error)
    fast = study.read_speeds(speeds)
    launch = chosen.launch(silent=as_json).but(duration=duration)
    planned = launch.plan()
    study.effects_of(planned)
    file = options.launch_file(launch, out, "rates")
    motions = 3 if peak_speeds(launch, fast)[1] else 1
    took = motions * sum(one.duration or 0.0 for one in at_speeds(launch, fast).values())
    title = f"rates: a touch of {launch.duration or 0.0:g} s, then again at other rates"
    with steps(title, 4, silent=as_json, seconds=PER_TICK * took * planned.graph.rate) as done:
        found = study.rates(launch, share, file, done, fast)
    if as_json:
        assert found.predicted is not None and found.measured is not None
        print_json({"ok": found.met, "file": str(file) if found.met else None, "error": share,
                    "set": found.predicted.overrides, "effects": [_data(rate) for rate in found.tried],
                    "predicted": _times(found.predicted), "measured": _times(found.measured),
                    "unseen": [_times(one) for one in found.unseen], "hand_m_s": found.reach,
                    "speeds": [{"speed": speed, **_times(one)} for speed, one in found.at.items()]})  # fmt: skip
    else:
        _print(found, file)
    if not found.met:
        raise typer.Exit(TROUBLE)


def _data(rate: Rate) -> dict[str, Any]:
    return {"node": rate.node, "effect": rate.effect, "every": rate.every, "before": rate.before,
            "time_constant_s": None if rate.idle else rate.constant, "error": rate.output_error,
            "force_error": rate.force_error}  # fmt: skip


def _times(one: Evaluation) -> dict[str, float]:
    return {"force_error": one.error, "force_error_worst": one.worst, "tick_s": one.mean,
            "tick_at_full_rates_s": one.reference}  # fmt: skip


def _print(found: RatesResult, file: Path) -> None:
    from palpate.studies.rates import errors_text, valid

    rows = []
    for rate in found.tried:
        constant = "idle" if rate.idle else f"{1e3 * rate.constant:.3g} ms"
        force = _percent(rate.force_error) if rate.in_loop else ""
        errors = ("", "") if rate.idle else (_percent(rate.output_error), force)
        rows.append((rate.node, rate.effect, constant, str(rate.every), str(rate.before), *errors))
    console().print(
        table(("", "effect", ">time\nconstant", ">every", ">\nnow", ">error, RMS %\noutput", ">\nforce"), rows)
    )
    if any(rate.idle for rate in found.tried):
        say("idle: its output does not change on this touch, so its rate is kept", "dim", wrap=True)
    assert found.predicted is not None and found.measured is not None
    for word, one in (("predicted", found.predicted), ("measured", found.measured)):
        full = f"{1e6 * one.reference:.0f} us with all effects at every tick (all CPU time)"
        say(f"{word:9} {errors_text(found.tried, one)}; mean tick {1e6 * one.mean:.0f} us; {full}", wrap=True)
    if found.unseen:
        say(f"          predicted from {len(found.unseen)} motions that the search has not seen", "dim", wrap=True)
    for speed, one in found.at.items() if len(found.at) > 1 else ():
        say(f"          at {speed:g} times its speed: {errors_text(found.tried, one)}", wrap=True)
    say("Errors are differences from the same graph with all effects at every tick.", "dim", wrap=True)
    say(valid(found.reach), "dim", wrap=True)
    if found.met:
        say(f"written   {file}: palpate run {file}", wrap=True)
        return
    why = "a new motion missed it" if found.unseen else "the touch changed, as the hand reacts to the force"
    say(f"The error limit is exceeded: {why}. Nothing is written. Try another --error.", "yellow", wrap=True)


def _percent(share: float) -> str:
    return f"{100 * share:.2g}" if share > 1e-9 else "0"
