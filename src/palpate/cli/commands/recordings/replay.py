"""`palpate replay`: a recorded touch computed again, in part or as a whole, or checked byte for byte."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal.options import File, Json, Sets, Trust
from palpate.cli.terminal.output import print_json
from palpate.launch.run.interrupts import until_ctrl_c
from palpate.launch.run.progress import ticks
from palpate.physics.errors import TROUBLE

if TYPE_CHECKING:
    from palpate.engine.plan import Plan
    from palpate.records.reader import Recording

EXAMPLE = "palpate replay runs/kidney.mcap --check"


def replay(
    file: File,
    graph: Annotated[str | None, typer.Option(help="Another graph, driven by the recorded device.")] = None,
    sets: Sets = None,
    only: Annotated[
        list[str] | None, typer.Option(help="Run this node only (may be repeated); play all others.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Compute every message again and compare byte for byte.")
    ] = False,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Relative tolerance of --check; by default 0 for the same arithmetic, else 1e-6.", min=0.0),
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Multiple of real time; as fast as possible if not given.")
    ] = None,
    begin: Annotated[float, typer.Option("--from", help="Show and pace from this time on, in s.", min=0.0)] = 0.0,
    end: Annotated[float | None, typer.Option("--to", help="End at this time, in s.", min=0.0)] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Repeat until Ctrl-C.")] = False,
    record: Annotated[Path | None, typer.Option(help="Record the replay to this file.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is not a recording.")] = False,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Compute a recorded touch again, or check it byte for byte.

    The recorded device drives the recorded graph, another graph, or with --only a part of it.
    --check computes every message of every node again from exactly the inputs that it names, and prints the first
    difference. Exit code 1 if there is one, or if the file is damaged or lacks messages: then it prints the range that
    was verified. Bytes are compared if the recording was computed with the same
    versions and instructions; otherwise numbers are compared within 1e-6, with a warning.
    """
    from palpate.launch.load.recording import recording_name
    from palpate.records.changed import change_plan
    from palpate.records.format.claim import claim_file
    from palpate.records.reader import Recording
    from palpate.records.stored import report_damage

    if speed is not None and not speed > 0:
        raise typer.BadParameter(f"--speed: found {speed}, expected more than 0")
    if end is not None and end < begin:
        raise typer.BadParameter(f"--to: found {end} s, expected not less than --from {begin} s")
    if record is not None:
        recording_name(record, "--record")
    with report_damage(file):
        recording = Recording(file)
        plan = change_plan(recording, sets or (), graph)
        if check:
            _refuse_with_check({"--only": only, "--record": record, "--speed": speed, "--graph": graph})
            _check(recording, plan, tolerance, as_json)
            return
        from palpate.cli.terminal.replayed import as_data, summary
        from palpate.records.changed import no_idle
        from palpate.records.replay import Replay

        player = Replay(recording, plan, only=only, speed=speed, begin=begin, end=end, out=record)
        no_idle(sets or [], plan, player.running)
        with contextlib.ExitStack() as stack:
            if record is not None:
                stack.enter_context(claim_file(record, force))
            if loop:
                stack.enter_context(until_ctrl_c())
            player.run()
            while loop:
                player.run()
        if as_json:
            print_json(as_data(player))
        else:
            summary(player)


def _refuse_with_check(options: dict[str, object]) -> None:
    """BadParameter: one of these options is given, which `--check` excludes."""
    for name, given in options.items():
        if given:
            raise typer.BadParameter(f"--check checks the recorded graph as a whole; leave out {name}")


def _check(recording: Recording, plan: Plan, given: float | None, as_json: bool) -> None:
    from palpate.cli.terminal.replayed import print_check
    from palpate.engine.provenance import rounding
    from palpate.records.differences import ELSEWHERE
    from palpate.records.verify import verify

    elsewhere = rounding(recording.about)
    tolerance = given if given is not None else ELSEWHERE if elsewhere else 0.0
    with ticks("checking", silent=as_json) as show:
        report = verify(recording, plan, tolerance=tolerance, show=show)
    if as_json:
        print_json({**report.to_spec(), "tolerance": tolerance, "computed_otherwise": elsewhere})
    else:
        print_check(recording, report, tolerance, elsewhere)
    if not report.verified:
        raise typer.Exit(TROUBLE)
