"""`palpate pictures`: the pictures of a recording."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import File, Json, Trust
from palpate.cli.terminal.output import console, tell
from palpate.physics.errors import TROUBLE


def pictures(
    file: File,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder; by default that of the recording.")] = None,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Draw the pictures of a recording. Exit code 1 if there was nothing that could be drawn."""
    from palpate.views.pictures import draw

    made = draw(file, out or file.parent, console=None if as_json else console())
    if as_json:
        tell({"ok": bool(made), "pictures": [str(path) for path in made]})
    else:
        for path in made:
            typer.echo(path)
        if not made:
            typer.echo(f"{file}: nothing that could be drawn", err=True)
    if not made:
        raise typer.Exit(TROUBLE)
