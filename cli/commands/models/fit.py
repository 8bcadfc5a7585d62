"""`palpate fit SESSIONS.csv`: force models, their spread and their errors, from measured indentation sessions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, say, tell
from palpate.physics.extras import missing

if TYPE_CHECKING:
    from palpate.models.fit.fit import Told


def fit(
    sessions: Annotated[
        Path | None, typer.Argument(help="CSV with the columns subject, session, depth (mm), force (N).")
    ] = None,
    subject: Annotated[list[str] | None, typer.Option(help="Only this subject; may be given several times.")] = None,
    out: Annotated[Path | None, typer.Option(help="YAML to write; else SESSIONS.model.yaml.")] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder for pictures of the fits.")] = None,
    mean: Annotated[
        str | None, typer.Option(help="Use this force model: linear, quadratic, fourier, gaussian, exponential.")
    ] = None,
    deviation: Annotated[str | None, typer.Option(help="Use this model of the standard deviation, same names.")] = None,
    folds: Annotated[int, typer.Option(help="Folds of the cross-validation.", min=3)] = 9,
    protocol: Annotated[
        str, typer.Option(help="whole: all sessions, a band for new ones; published: two dropped, a normal law.")
    ] = "whole",
    any_stiffness: Annotated[
        bool, typer.Option("--any-stiffness", help="Accept forces and depths even if the stiffness is implausible.")
    ] = False,
    depth_limit: Annotated[float | None, typer.Option(help="Leave out rows deeper than this, in mm.")] = None,
    as_json: Json = False,
    example: Annotated[Path | None, typer.Option(help="Write a CSV of synthetic sessions, and exit.")] = None,
) -> None:
    """Fit force models to indentation sessions.

    Five models of the force and of its standard deviation are compared by nine-fold cross-validation; the best go into
    a YAML file that the node contact.Probabilistic takes as its `model`.
    """
    from palpate.models.fit.fit import fit_sessions, write_example
    from palpate.models.fit.sessions import SessionError
    from palpate.physics.writable import check_folder

    if example is not None:
        write_example(example)
        if as_json:
            tell({"ok": True, "file": str(example)})
        else:
            typer.echo(f"Wrote synthetic sessions of two subjects to {example}.")
        return
    if sessions is None:
        raise SessionError("no file: give SESSIONS.csv, or --example FILE.csv to write one to try")
    if pictures is not None:
        try:
            check_folder(pictures)
        except OSError as error:
            raise SessionError(f"{pictures}: cannot be written: {error.strerror}") from None
    fitted = fit_sessions(
        sessions, subjects=subject or [], out=out, mean=mean, deviation=deviation, folds=folds,
        depth_limit=depth_limit, protocol=protocol, any_stiffness=any_stiffness,
    )  # fmt: skip
    drawn = [] if pictures is None else _draw(fitted, pictures)
    if as_json:
        tell({"ok": True, "subjects": fitted.data, "notes": fitted.notes, "file": str(fitted.file), "pictures": drawn})
        return
    for table in fitted.tables:
        console(markup=True).print(table)
    for note in [*fitted.notes, f"Wrote {', '.join([str(fitted.file), *drawn])}"]:
        say(note, wrap=True)


def _draw(fitted: Told, folder: Path) -> list[str]:
    """The pictures of every subject; their files. SessionError: no matplotlib, or a folder that cannot be written."""
    from palpate.models.fit.sessions import SessionError

    try:
        from palpate.views.pictures.models.fit import draw_choice
    except ImportError as error:
        raise SessionError(missing("--pictures", error.name, "view")) from None
    paths: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for number, choice in enumerate(fitted.chosen, 1):
            paths += draw_choice(choice, folder / f"subject-{number}")
    except OSError as error:
        raise SessionError(f"{folder}: cannot be written: {error.strerror}") from None
    return [str(path) for path in paths]
