"""`palpate fit SESSIONS.csv`: force models, their spread and their errors, from measured indentation sessions."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

MISUSE = 2
"""Exit code where file or arguments are wrong."""


def fit(
    sessions: Annotated[
        Path | None, typer.Argument(help="CSV with the columns subject, session, depth (mm), force (N)")
    ] = None,
    law: Annotated[
        str | None, typer.Option(help="Fit a contact law instead: hertz, power, exponential, hunt-crossley")
    ] = None,
    subject: Annotated[list[str] | None, typer.Option(help="Only this subject; may be given several times")] = None,
    out: Annotated[Path | None, typer.Option(help="YAML to write; else SESSIONS.model.yaml or .law.yaml")] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder for pictures of the fits")] = None,
    mean: Annotated[
        str | None, typer.Option(help="Take this force model: linear, quadratic, fourier, gaussian, exponential")
    ] = None,
    deviation: Annotated[str | None, typer.Option(help="Take this model of the standard deviation, same names")] = None,
    folds: Annotated[int, typer.Option(help="Folds of the cross-validation", min=3)] = 9,
    depth_limit: Annotated[float | None, typer.Option(help="Leave out rows deeper than this, in mm")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables")] = False,
    example: Annotated[Path | None, typer.Option(help="Write a CSV of synthetic sessions, and end")] = None,
) -> None:
    """Fit force models, or a contact law, to indentation sessions.

    Five models of the force and of its standard deviation are compared by nine-fold cross-validation; the best go into
    a YAML file that the node contact.Probabilistic takes as its `model`.
    """
    from palpate.launch.fitting.fit import fit_sessions, write_example
    from palpate.launch.fitting.sessions import SessionError

    try:
        if example is not None:
            write_example(example)
            text = f"Wrote synthetic sessions of two made-up subjects to {example}."
            typer.echo(json.dumps({"ok": True, "file": str(example)}) if as_json else text)
            return
        if sessions is None:
            raise SessionError("no file: give SESSIONS.csv, or --example FILE.csv to write one to try")
        told = fit_sessions(
            sessions,
            law=law,
            subjects=subject or [],
            out=out,
            pictures=pictures,
            mean=mean,
            deviation=deviation,
            folds=folds,
            depth_limit=depth_limit,
        )
    except SessionError as error:
        if as_json:
            typer.echo(json.dumps({"ok": False, "faults": str(error).split("\n")}, indent=2))
        else:
            sys.stderr.write(f"{error}\n")
        raise typer.Exit(MISUSE) from None
    if as_json:
        found = {"ok": True, "subjects": told.data, "notes": told.notes}
        typer.echo(json.dumps(found | {"file": str(told.file), "pictures": told.pictures}, indent=2))
        return
    from rich.console import Console

    console = Console()
    for table in told.tables:
        console.print(table)
    for note in [*told.notes, f"Wrote {', '.join([str(told.file), *told.pictures])}"]:
        console.print(note, markup=False, highlight=False)
