"""`palpate plot`: any fields of a recording over time, or over one another."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import File, Trust


def plot(
    file: File,
    names: Annotated[list[str], typer.Argument(help="Fields: contact.force tissue.indentation.", metavar="FIELD...")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="PNG, SVG or PDF; FILE-plot.png if left out.")] = None,
    over: Annotated[str | None, typer.Option(help="Field to draw over, in place of time.", metavar="FIELD")] = None,
    trust: Trust = None,
) -> None:
    """Draw fields of a recording over time, or --over another field, with their units, one axis each."""
    from palpate.views.errors import PictureError
    from palpate.views.run import Run

    target = out or file.with_name(f"{file.stem}-plot.png")
    if target.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise PictureError(f"{target}: found {target.suffix or 'no ending'!r}, expected .png, .svg or .pdf")
    figure = Run(file).plot(*names, over=over)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target)
    typer.echo(target)
