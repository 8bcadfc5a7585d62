"""`palpate picture`: the deformed surface at one instant of a recording."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import ColourOption, File, Trust, instant


def picture(
    file: File,
    at: Annotated[float, typer.Option(help="Time in the recording: 1.2, '1200 ms'.", parser=instant, metavar="TIME")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="PNG; FILE-picture.png if left out.")] = None,
    colour: ColourOption = "displacement",
    trust: Trust = None,
) -> None:
    """Draw the surface under the finger at one instant, coloured by displacement or another field."""
    from palpate.views.surface import colour as colours
    from palpate.views.surface.film import picture as draw

    target = out or file.with_name(f"{file.stem}-picture.png")
    if target.suffix.lower() != ".png":
        raise typer.BadParameter(f"{target}: found {target.suffix or 'no ending'!r}, expected .png")
    drawn = draw(file, at, target, colours.colour(colour))
    typer.echo(f"{target}  at {drawn:.3f} s")
