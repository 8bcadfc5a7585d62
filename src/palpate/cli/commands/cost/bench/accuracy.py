"""`palpate bench accuracy`: error and step time of each model on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import console, print_json, say, table
from palpate.launch.run.progress import steps
from palpate.physics.errors import RunError

if TYPE_CHECKING:
    from palpate.studies.accuracy.cells import Cell

EXAMPLE = "palpate bench accuracy --quick"


def accuracy(
    touches: Annotated[list[str] | None, typer.Option("--touch", help="Only this touch; may be repeated.")] = None,
    only: Annotated[list[str] | None, typer.Option("--method", help="Only this method; may be repeated.")] = None,
    body: Annotated[
        list[str] | None, typer.Option(help="Also a custom body: mylab.tissue.Liver; may be repeated.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Few settings, one repeat: 2 min on one core.")] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Recompute cached results.")] = False,
    out: Annotated[Path, out_option("Folder of page, picture and table.")] = Path("accuracy"),
    as_json: Json = False,
) -> None:
    """Measure the error and the step time of every model.

    Compares standard touches with reference solutions. Writes a page, picture and table. An interrupted run resumes.
    """
    from dataclasses import asdict

    from palpate.launch.load.classes import find_class
    from palpate.physics.writable import check_folder
    from palpate.studies.accuracy import methods as known
    from palpate.studies.accuracy.cases import choose_cases
    from palpate.studies.accuracy.cells import compute, matrix
    from palpate.studies.accuracy.output.report import about as versions
    from palpate.studies.accuracy.output.report import write_report

    about, wanted = versions(), choose_cases(touches)
    methods = known.choose_methods(only, {name: find_class(name) for name in body or ()})
    todo = matrix(wanted, methods, quick)
    check_folder(out)

    title = f"bench accuracy: {len(todo)} cells, each a model on a touch"
    with steps(title, len(todo), silent=as_json) as done:
        cells = compute(todo, 1 if quick else 3, fresh, str(about["processor"]), done)
    if not any(cell.status == "ok" for cell in cells):
        why = dict.fromkeys(f"{cell.title}, {cell.touch}: {cell.why}" for cell in cells)
        raise RunError(f"none of these methods supports any of these touches ({'; '.join(why)})")
    files = write_report(cells, about, out)
    if as_json:
        print_json({"ok": True, "about": about, "files": {k: str(v) for k, v in files.items()},
                    "cells": [asdict(c) for c in cells]})  # fmt: skip
    else:
        _print(cells, files)


def _print(cells: list[Cell], files: dict[str, Path]) -> None:
    from palpate.launch.run.busy import busy
    from palpate.physics import extras
    from palpate.studies.accuracy.output.page import LEGEND
    from palpate.studies.accuracy.output.pareto import advice, best, duration, elsewhere, of_bodies, summaries, unable
    from palpate.studies.accuracy.reference_solvers import missing

    summary = summaries(of_bodies(cells))
    heads = ("", ">force error\nRMS, median [%]", ">worst\ntouch [%]", ">step\np50", ">\np99", ">touches\ncomputed",
             ">\nunsupported")  # fmt: skip
    rows = [
        (f"{s.title}, {s.fidelity}", f"{100 * s.error:.2g}", f"{100 * s.worst:.2g}", duration(s.p50), duration(s.p99),
         str(s.computed), str(s.charged or ""))
        for s in summary
    ]  # fmt: skip
    for sentence in (advice(summary), *elsewhere(cells)):
        say(sentence, wrap=True)
    if why := busy(included=1):
        say(f"{why}: p50 and p99 are too long.", "yellow")
    console().print(table(heads, rows, fixed=heads[1:], bold=best(summary)))
    say(LEGEND, wrap=True)
    if none := unable(cells):
        say(f"These support no touch: {', '.join(none)}.", wrap=True)
    if kept := sum(cell.kept for cell in cells):
        say(f"{kept} of {len(cells)} cells, times included, are cached from earlier runs; --fresh recomputes them")
    for text in missing():
        say(f"not installed  {text}")
    if "overview" not in files:
        say(extras.missing("no pictures", "matplotlib", "view"))
    for name, file in files.items():
        say(f"{name:14} {file}")
