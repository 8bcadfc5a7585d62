"""`palpate replay`: a recorded touch computed again, in part or as a whole, or checked byte for byte."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import TROUBLE, Json, Sets, Trust, console, tell
from palpate.launch.commands.info import File

if TYPE_CHECKING:
    from palpate.engine.plan import Plan
    from palpate.records.differences import Report
    from palpate.records.reader import Recording
    from palpate.records.replay import Replay


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
    step: Annotated[bool, typer.Option("--step", help="Wait for Enter at each instant; q ends.")] = False,
    record: Annotated[Path | None, typer.Option(help="Record the replay to this file.")] = None,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Replay a recording: its device drives the recorded graph, another graph, or with --only a part of it.

    --check computes every message of every node again from exactly the inputs that it names, and prints the first
    difference. Exit code 1 if there is one. Bytes are compared if the recording was computed with the same
    versions and instructions, else numbers within 1e-6, and it says so.
    """
    from palpate.records.changed import changed
    from palpate.records.reader import Recording

    if speed is not None and not speed > 0:
        raise typer.BadParameter(f"--speed: found {speed}, expected more than 0")
    if end is not None and end < begin:
        raise typer.BadParameter(f"--to: found {end} s, expected not less than --from {begin} s")
    recording = Recording(file)
    plan = changed(recording, sets or (), graph)
    if check:
        for name, given in (("--only", only), ("--record", record), ("--speed", speed), ("--graph", graph)):
            if given:
                raise typer.BadParameter(f"--check checks the recorded graph as a whole; leave out {name}")
        _check(recording, plan, tolerance, as_json)
        return
    _play(recording, plan, sets or [], only, speed, begin, end, loop, step, record, as_json)


def _check(recording: Recording, plan: Plan, given: float | None, as_json: bool) -> None:
    from palpate.engine.provenance import rounding
    from palpate.records.differences import ELSEWHERE
    from palpate.records.verify import verify

    elsewhere = rounding(recording.about)
    tolerance = given if given is not None else ELSEWHERE if elsewhere else 0.0
    if as_json:
        report = verify(recording, plan, tolerance=tolerance)
        tell({**report.to_spec(), "tolerance": tolerance, "computed_otherwise": elsewhere})
    else:
        from rich.progress import Progress

        with Progress(console=console(stderr=True), transient=True) as progress:
            task = progress.add_task("checking", total=None)
            report = verify(
                recording, plan, tolerance=tolerance,
                show=lambda tick, last: progress.update(task, completed=tick, total=last),
            )  # fmt: skip
        _print(recording, report, tolerance, elsewhere)
    if not report.ok:
        raise typer.Exit(TROUBLE)


def _print(recording: Recording, report: Report, tolerance: float, elsewhere: list[str]) -> None:
    from rich.text import Text

    out = console(soft_wrap=True)
    checked = sum(node.checked for node in report.nodes.values())
    if report.first is not None:
        out.print(Text(f"first difference: {report.first}", style="red"))
        for name, node in report.nodes.items():
            if node.differing:
                out.print(
                    Text(f"  {name}: {node.differing} of {node.checked} messages differ, by {node.largest:.2g} at most")
                )
    elif checked:
        how = f"equal within {tolerance:g}" if tolerance else "bit-equal"
        out.print(Text(f"{checked} messages of {len(report.nodes)} nodes computed again: {how}", style="green"))
    else:
        out.print(Text("no message could be checked", style="red"))
    if elsewhere:
        how = f"numbers are compared within {tolerance:g}" if tolerance else "bytes are compared nevertheless"
        out.print(Text(f"Computed with other versions or instructions: {'; '.join(elsewhere)}; {how}.", style="yellow"))
    for name, node in report.nodes.items():
        if node.stopped:
            out.print(Text(f"not checked: {name}: {node.stopped}", style="yellow"))
    if report.cut:
        ending = recording.ending or f"{recording.path} was recovered"
        out.print(Text(f"{ending} The last messages may lack some of their inputs.", style="yellow"))


def _play(
    recording: Recording, plan: Plan, sets: list[str], only: list[str] | None, speed: float | None, begin: float,
    end: float | None, loop: bool, step: bool, record: Path | None, as_json: bool,
) -> None:  # fmt: skip
    from palpate.records.changed import no_idle
    from palpate.records.replay import Replay

    player = Replay(recording, plan, only=only, speed=speed, begin=begin, end=end, out=record)
    no_idle(sets, plan, player.running)
    show = _stepper(recording) if step else lambda tick, time, messages: True
    try:
        while True:
            player.run(show)
            if not loop:
                break
    except KeyboardInterrupt:
        pass
    if as_json:
        tell(_data(player))
    else:
        _summary(player)


def _data(player: Replay) -> dict:
    return {
        "ok": True,
        "complete": player.recording.complete,
        "ending": player.recording.ending,
        "seconds": player.seconds,
        "wall": player.wall,
        "substituted": player.player.substituted if player.player else 0,
        "nodes": {
            name: {"messages": r.checked, "differing": r.differing, "largest": r.largest}
            for name, r in player.reports.items()
        },
    }


def _summary(player: Replay) -> None:
    from rich.table import Table
    from rich.text import Text

    out = console()
    times = f", {player.seconds / player.wall:.2f} x real time" if player.wall > 0 else ""
    out.print(Text(f"{player.seconds:.3f} s replayed in {player.wall:.2f} s{times}"))
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("node that ran")
    for title in ("messages", "other than recorded", "largest difference"):
        table.add_column(title, justify="right")
    for name, report in player.reports.items():
        table.add_row(
            name, str(report.checked), str(report.differing), f"{report.largest:.2g}" if report.differing else ""
        )
    out.print(table)
    if player.player and player.player.substituted:
        out.print(Text(f"{player.player.substituted} lost inputs were replaced by the previous ones",
                       style="yellow"))  # fmt: skip
    if not player.recording.complete:
        out.print(Text(player.recording.ending, style="yellow"), soft_wrap=True)


def _stepper(recording: Recording):
    """Prints each instant and waits for a line: Enter goes on, q ends, a number goes on by so many instants."""
    from palpate.launch.commands.echo import line
    from palpate.messages import unpack

    out = console(soft_wrap=True)
    left = 0

    def show(tick: int, time: int, messages: dict[str, bytes]) -> bool:
        nonlocal left
        left -= 1
        if left > 0:
            return True
        for stream, payload in messages.items():
            if stream in recording.streams:
                out.print(f"[bold]{stream:>12}[/]", line(unpack(payload, recording.streams[stream].type)))
        print("Enter: next, a number: so many, q: end > ", end="", flush=True)
        answer = sys.stdin.readline()
        left = int(answer) if answer.strip().isdigit() else 1
        return bool(answer) and answer.strip().lower() not in ("q", "quit")

    return show
