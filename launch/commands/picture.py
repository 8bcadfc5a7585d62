"""`palpate picture`: the deformed surface at one instant of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.launch.commands.common import Trust

ColourOption = Annotated[
    str,
    typer.Option("--colour", help="displacement, pressure, slip or strain (largest of the surface's triangles)."),
]


def moment(text: str) -> float:
    """[s] of an instant of a recording: 1.2, '1200 ms', 0."""
    from palpate.launch.load.units import UnitError, convert

    try:
        return convert(text, "s")
    except UnitError as error:
        raise typer.BadParameter(str(error)) from None


def picture(
    file: Annotated[Path, typer.Argument(help="A recording (.mcap).", metavar="FILE")],
    at: Annotated[float, typer.Option(help="Time in the recording: 1.2, '1200 ms'.", parser=moment, metavar="TIME")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="PNG; FILE-picture.png if left out.")] = None,
    colour: ColourOption = "displacement",
    trust: Trust = None,
) -> None:
    """Draw the surface under the finger at one instant, coloured by displacement or another field."""
    from palpate.views.pictures import colour as colours
    from palpate.views.pictures.film import picture as draw

    target = out or file.with_name(f"{file.stem}-picture.png")
    if target.suffix.lower() != ".png":
        raise typer.BadParameter(f"{target}: found {target.suffix or 'no ending'!r}, expected .png")
    drawn = draw(file, at, target, colours.colour(colour))
    typer.echo(f"{target}  at {drawn:.3f} s")
