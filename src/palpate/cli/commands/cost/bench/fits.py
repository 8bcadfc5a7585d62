"""`palpate bench fits`: random presses of every rig and law, and how often intervals contain the true values."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import print_json, say, write
from palpate.launch.run.progress import StageBars
from palpate.physics.errors import ArgumentError

EXAMPLE = "palpate bench fits --presses 20 --case 'ball hertz'"


def fits(
    presses: Annotated[int, typer.Option(help="Number of presses of each case.", min=1, max=1_000_000)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the random presses.", min=0)] = 1,
    case: Annotated[list[str] | None, typer.Option(help="Only this rig and law; may be repeated.")] = None,
    first: Annotated[int, typer.Option(help="Number of the first press of each case.", min=0)] = 0,
    worst: Annotated[int, typer.Option(help="Number of the worst presses to print, and to save as CSV.", min=0)] = 5,
    results: Annotated[
        Path | None, typer.Option(help="File of results that a search adds to and resumes; else OUT/presses.jsonl.")
    ] = None,
    runs: Annotated[
        int, typer.Option(help="Instead fit this number of random touches with `palpate fit run`.", min=0)
    ] = 0,
    out: Annotated[Path, out_option("Folder of results, tables and worst presses.")] = Path("fits"),
    as_json: Json = False,
) -> None:
    """Search for presses on which `palpate fit tissue` is wrong without saying so.

    Draws travel, rows in contact, noise, drift, cycles and other flaws, fits the law that made each press, and counts
    by rig and law, and by disturbance, how often all true values lie in their intervals. With --runs it does the same
    for `palpate fit run` and touches with random bodies, settings and noise. Ctrl-C prints what was found so far. The
    exit code is 1 if a value is silently wrong.
    """
    from palpate.physics.writable import check_file, check_folder
    from palpate.studies.fits.presses import NAMES
    from palpate.studies.fits.report import plain, save_press, text, worst_of
    from palpate.studies.fits.search import KEPT, Outcome, search
    from palpate.studies.fits.tables import TABULATED, make_tables

    names = case or list(NAMES)
    if unknown := [name for name in names if name not in NAMES]:
        raise ArgumentError(f"--case: found {', '.join(unknown)}, expected some of {', '.join(NAMES)}")
    check_folder(out)
    if runs:
        _runs(runs, seed, first, out, as_json)
        return
    results = results or out / KEPT
    check_file(results)
    found: list[Outcome] = []
    stopped = None
    try:
        with StageBars(silent=as_json) as bars:
            if tabulated := tuple(name for name in names if name in TABULATED):
                make_tables(tabulated, out, bars.begin("bench fits: tables of finite elements, once per folder", ""))
            done = bars.begin(f"bench fits: {presses} presses of {len(names)} cases", "")
            for outcome in search(names, presses, seed, out, done, first, results):
                found.append(outcome)
    except KeyboardInterrupt as error:  # what was found so far is reported
        stopped = error
    listed = worst_of(found, worst)
    commands = [save_press(outcome, out) for outcome in listed]
    report = plain(found, listed, commands) | {"interrupted": stopped is not None}
    (out / "fits.txt").write_text(text(found, listed, commands), encoding="utf-8")
    if as_json:
        print_json(report)
    else:
        write(text(found, listed, commands))
        say(f"written {out}/fits.txt, {results}; the same command resumes, a larger --presses adds to it", wrap=True)
    if stopped is not None:
        raise stopped
    if not report["ok"]:
        raise typer.Exit(1)


def _runs(count: int, seed: int, first: int, out: Path, as_json: bool) -> None:
    """Search random touches, print what was found, and exit with 1 if a value is silently wrong."""
    from palpate.studies.inverse.search import RunOutcome, search, summary, text

    found: list[RunOutcome] = []
    stopped = None
    try:
        with StageBars(silent=as_json) as bars:
            done = bars.begin(f"bench fits: {count} touches", "")
            for outcome in search(count, seed, out, done, first):
                found.append(outcome)
    except KeyboardInterrupt as error:  # what was found so far is reported
        stopped = error
    report = summary(found) | {"interrupted": stopped is not None}
    if found:
        (out / "runs.txt").write_text(text(found), encoding="utf-8")
    if as_json:
        print_json(report)
    elif found:
        write(text(found))
        say(f"written {out}/runs.txt, runs.jsonl; the same command resumes, a larger --runs adds to it", wrap=True)
    if stopped is not None:
        raise stopped
    if not report["ok"]:
        raise typer.Exit(1)
