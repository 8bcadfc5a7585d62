"""`palpate film`: the deformed surface through a recording, as MP4 or GIF."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import ColourOption, File, Trust
from palpate.cli.terminal.output import console
from palpate.cli.terminal.progress import Stages


def film(
    file: File,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="MP4 or GIF; FILE.mp4 if left out.")] = None,
    rate: Annotated[float, typer.Option(help="[1/s] frames of the film.", min=1, max=60)] = 25.0,
    speed: Annotated[float, typer.Option(help="0.5 is slow motion.", min=1e-3, max=100)] = 1.0,
    colour: ColourOption = "displacement",
    trust: Trust = None,
) -> None:
    """Film a recording: the surface under the finger, coloured by displacement or another field."""
    from palpate.views.surface import colour as colours
    from palpate.views.surface.film import film as make

    target = out or file.with_suffix(".mp4")
    with Stages(console(stderr=True)) as stages:
        drawn = stages.begin("film", "drawing frames")
        frames = make(file, target, rate, speed, colours.colour(colour), lambda text: typer.echo(text, err=True), drawn)
    typer.echo(f"{target}  {frames} frames, {frames / rate:.1f} s")
