"""`palpate experiment`: psychophysics on a page in the browser, with a recording of each interval."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.options import Host, Json, NoOpen, Port, Sets, out_option
from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, table
from palpate.launch.run.progress import steps

EXAMPLE = "palpate experiment kidney-stiffness --simulate"


def experiment(
    file: Annotated[
        str | None, typer.Argument(help="Experiment (.yaml), or the name of one that ships.", metavar="EXPERIMENT")
    ] = None,
    participant: Annotated[
        str | None, typer.Option(help="Letters and digits; default: the first with an incomplete session, or none yet.")
    ] = None,
    session: Annotated[int | None, typer.Option(help="Number of the session; default: the last one.", min=1)] = None,
    out: Annotated[Path | None, out_option("Default: runs/experiments/EXPERIMENT.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Resume a session without asking.")] = False,
    simulate: Annotated[bool, typer.Option("--simulate", help="Simulate the `observer:` of the experiment.")] = False,
    observer: Annotated[Path | None, typer.Option(help="Simulate the observer of this file (.yaml).")] = None,
    analyse: Annotated[Path | None, typer.Option(help="Folder of data to analyse: print and draw the results.")] = None,
    sets: Sets = None,
    organ: options.OrganOption = None,
    unit: options.UnitOption = None,
    piece: options.PieceOption = None,
    label: options.LabelOption = None,
    repair: options.RepairOption = False,
    port: Port = 0,
    host: Host = "127.0.0.1",
    no_open: NoOpen = False,
    as_json: Json = False,
) -> None:
    """Run a psychophysical experiment, or analyse its data.

    Prints thresholds, JNDs and Weber fractions with 95 % intervals. Ctrl-C ends it with exit code 130; the same command
    resumes at the first unanswered trial.
    """
    if analyse is not None:
        _analyse(analyse, as_json)
        return
    if file is None:
        raise typer.BadParameter("expected an EXPERIMENT, such as kidney-stiffness, or --analyse FOLDER")
    from palpate.studies.psychophysics.opening import OF_EXPERIMENT, open_sitting

    simulated: Path | Literal["observer"] | None = observer or (OF_EXPERIMENT if simulate else None)
    replaced = options.say_organ_file(organ, unit, piece, repair, silent=as_json, label=label)
    given = list(sets or [])
    with open_sitting(file, out, participant, session, given, resume, _confirm, simulated, replaced) as sitting:
        place = f"sub-{sitting.participant} ses-{sitting.session:02d}: {sitting.table.path}"
        for note in [*sitting.notes, place]:
            say(note, err=True)
        stopped = KeyboardInterrupt()
        try:
            if simulated is not None:
                total = 0 if sitting.trial is None else sitting.trial.total
                with steps(f"experiment {file}", total, silent=as_json, timed=False) as done:
                    sitting.simulate(lambda trial: done(f"trial {trial.number}"))
            elif not sitting.ended:
                from palpate.cli.terminal.browser import show

                page = sitting.page()
                show(page, "do", port, host, no_open, lambda: page.ended)
                page.check()
        except KeyboardInterrupt as error:  # print the answers so far, then raise it again
            stopped = error
        count = len(sitting.table.rows)
    if as_json:
        print_json({"ok": sitting.ended, "folder": str(sitting.folder), "participant": sitting.participant,
                    "session": sitting.session, "trials": count, "table": str(sitting.table.path)})  # fmt: skip
    else:
        what = f"over: palpate experiment --analyse {sitting.folder}" if sitting.ended else "the same command resumes"
        say(f"{count} trials; {what}")
    if not sitting.ended:
        raise stopped


def _confirm(text: str) -> bool | None:
    return typer.confirm(text, err=True) if sys.stdin.isatty() else None


def _analyse(folder: Path, as_json: bool) -> None:
    from palpate.studies.psychophysics.analysis import analyse, rows_of, save
    from palpate.studies.psychophysics.pictures import draw_answers

    outcomes = analyse(folder)
    files = [*save(outcomes, folder), *draw_if_possible(draw_answers, outcomes, folder)]
    if as_json:
        print_json({"ok": True, "folder": str(folder), "outcomes": [one.to_spec() for one in outcomes], "files": files})
        return
    heads = ["who", "block", ">trials", "number", ">estimate", ">95 % interval"]
    tasks = ", ".join(dict.fromkeys(one.task for one in outcomes))
    console(soft_wrap=True).print(table(heads, rows_of(outcomes), title=tasks, fixed=("number", ">95 % interval")))
    for one in outcomes:
        for note in one.notes:
            say(f"{one.participant}, {one.block}: {note}")
    for file in files:
        say(file)
