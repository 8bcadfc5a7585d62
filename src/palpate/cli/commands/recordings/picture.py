"""`palpate picture`: draw a recording: standard pictures, fields over time, the surface, a film; or an organ."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.options import ENDINGS, ColourOption, File, Json, Trust, check_ending, instant, out_option
from palpate.cli.terminal.output import print_json, say, write
from palpate.cli.terminal.run_summary import standard_pictures

EXAMPLE = "palpate picture runs/kidney.mcap --at '350 ms'"
ORGAN = "organ"  # instead of a recording: the next word is the file of an organ


def picture(
    file: File,
    names: Annotated[
        list[str] | None, typer.Argument(help="Fields: contact.force tissue.indentation.", metavar="[FIELD...]")
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(help="The surface at this instant: 1.2, '1200 ms'.", parser=instant, metavar="TIME"),
    ] = None,
    film: Annotated[bool, typer.Option("--film", help="A film of the surface, MP4 or GIF.")] = False,
    out: Annotated[Path | None, out_option("File, or folder of the standard pictures; default: next to FILE.")] = None,
    over: Annotated[str | None, typer.Option(help="Field to draw over, instead of time.", metavar="FIELD")] = None,
    colour: ColourOption = "displacement",
    rate: Annotated[float, typer.Option(help="Frames per second of the film.", min=1, max=60)] = 25.0,
    speed: Annotated[float, typer.Option(help="Speed of the film; 0.5 is slow motion.", min=1e-3, max=100)] = 1.0,
    unit: options.UnitOption = None,
    piece: options.PieceOption = None,
    label: options.LabelOption = None,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Draw a recording: pictures, fields, one instant, a film.

    Without options it draws the standard pictures of all streams; with FIELD... these fields over time or --over
    another field; with --at the surface under the finger at one instant; with --film the surface as a film. `picture
    organ FILE` draws a mesh or a label of a segmentation: surface and voxels in three planes, volume, smallest
    thickness, where the finger does not fit. Exit code 1 if there was nothing to draw.
    """
    if str(file) == ORGAN and not file.exists():
        if names is None or len(names) != 1:
            raise typer.BadParameter("expected one file after `organ`: palpate picture organ seg.nii.gz --label liver")
        from palpate.cli.terminal.organ_picture import picture_organ

        picture_organ(Path(names[0]), unit, piece, label, out, as_json)
        return
    for option, given in (("--unit", unit), ("--piece", piece), ("--label", label)):
        if given is not None:
            raise typer.BadParameter(f"{option} is for an organ: palpate picture organ FILE")
    if sum((bool(names), at is not None, film)) > 1:
        raise typer.BadParameter("FIELD..., --at and --film are different pictures: use one of them")
    if over is not None and not names:
        raise typer.BadParameter("--over needs a FIELD to draw over it")
    swapped = next((name for name in names or () if not file.exists() and Path(name).is_file()), None)
    if swapped is not None:
        raise typer.BadParameter(f"found {str(file)!r} first, expected FILE first: palpate picture {swapped} {file}")
    note = ""
    if names:
        made = [_plot(file, names, over, out or file.with_name(f"{file.stem}-plot.png"))]
    elif at is not None:
        target = out or file.with_name(f"{file.stem}-picture.png")
        note = _instant(file, at, colour, target)
        made = [target]
    elif film:
        made = [out or file.with_suffix(".mp4")]
        note = _film(file, made[0], rate, speed, colour, as_json)
    else:
        if out is not None and out.suffix.lower() in ENDINGS:
            raise typer.BadParameter(f"found {out}, expected a folder for the standard pictures", param_hint="--out")
        made = standard_pictures(file, out or file.parent, silent=as_json)
    if as_json:
        print_json({"ok": True, "pictures": [str(path) for path in made]})
    else:
        for path in made:
            write(f"{path}{note}")


def _plot(file: Path, names: list[str], over: str | None, target: Path) -> Path:
    from palpate.views.pictures.style import save
    from palpate.views.run import Run

    check_ending(target, ENDINGS)
    figure = Run(file).plot(*names, over=over)
    target.parent.mkdir(parents=True, exist_ok=True)
    save(figure, target)
    return target


def _instant(file: Path, at: float, colour: str, target: Path) -> str:
    from palpate.views.surface import colour as colours
    from palpate.views.surface.film import picture

    check_ending(target, ENDINGS[:1])
    return f"  at {picture(file, at, target, colours.colour(colour)):.3f} s"


def _film(file: Path, target: Path, rate: float, speed: float, colour: str, silent: bool) -> str:
    from palpate.launch.run.progress import StageBars
    from palpate.views.surface import colour as colours
    from palpate.views.surface.film import film

    with StageBars(silent) as stages:
        drawn = stages.begin("film", "drawing frames")
        frames = film(file, target, rate, speed, colours.colour(colour), lambda text: say(text, err=True), drawn)
    return f"  {frames} frames, {frames / rate:.1f} s"
