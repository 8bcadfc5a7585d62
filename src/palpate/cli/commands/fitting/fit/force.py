"""`palpate fit force SESSIONS.csv`: force models, their spread and their errors, from measured indentation sessions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Dialect, Json, NoPictures, out_option
from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, write

EXAMPLE = "palpate fit force sessions.csv -o finger.model.yaml"


def force(
    sessions: Annotated[
        Path | None, typer.Argument(help="CSV with the columns subject, session, depth (mm), force (N).")
    ] = None,
    subject: Annotated[list[str] | None, typer.Option(help="Only this subject; may be repeated.")] = None,
    out: Annotated[Path | None, out_option("YAML to write; else SESSIONS.model.yaml. Pictures go next to it.")] = None,
    no_pictures: NoPictures = False,
    mean: Annotated[
        str | None, typer.Option(help="Use this force model: linear, quadratic, fourier, gaussian, exponential.")
    ] = None,
    deviation: Annotated[str | None, typer.Option(help="Use this model of the standard deviation, same names.")] = None,
    folds: Annotated[int, typer.Option(help="Folds of the cross-validation.", min=3)] = 9,
    protocol: Annotated[
        str, typer.Option(help="whole: all sessions, Student's t; published: two dropped, normal distribution.")
    ] = "whole",
    any_stiffness: Annotated[
        bool, typer.Option("--any-stiffness", help="Accept forces and depths even if the stiffness is implausible.")
    ] = False,
    depth_limit: Annotated[float | None, typer.Option(help="Leave out rows deeper than this, in mm.")] = None,
    dialect: Dialect = "",
    as_json: Json = False,
    example: Annotated[Path | None, typer.Option(help="Write a CSV of synthetic sessions, and exit.")] = None,
) -> None:
    """Fit force models and their spread to indentation sessions.

    Compares five models of the force and of its standard deviation by cross-validation, and writes the best to a YAML
    file that the node contact.Probabilistic takes as its `model`.
    """
    from palpate.models.fit.fit import fit_sessions, write_example
    from palpate.models.fit.sessions import SessionError
    from palpate.views.pictures.models.fit import draw_fit

    if example is not None:
        write_example(example)
        if as_json:
            print_json({"ok": True, "file": str(example)})
        else:
            write(f"Wrote synthetic sessions of two subjects to {example}.")
        return
    if sessions is None:
        raise SessionError("no file: give SESSIONS.csv, or --example FILE.csv to write one to try")
    fitted = fit_sessions(
        sessions, subjects=subject or [], out=out, mean=mean, deviation=deviation, folds=folds,
        depth_limit=depth_limit, protocol=protocol, any_stiffness=any_stiffness, dialect=dialect,
    )  # fmt: skip
    pictures = [] if no_pictures else [str(path) for path in draw_if_possible(draw_fit, fitted.chosen, fitted.file)]
    if as_json:
        print_json(
            {"ok": True, "subjects": fitted.data, "notes": fitted.notes, "file": str(fitted.file), "pictures": pictures}
        )
        return
    for table in fitted.tables:
        console(markup=True).print(table)
    for note in [*fitted.notes, f"Wrote {', '.join([str(fitted.file), *pictures])}"]:
        say(note, wrap=True)
