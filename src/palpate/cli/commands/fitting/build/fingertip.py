"""`palpate build fingertip`: build the geometry file of a beam bundle from images of a finger."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, NoPictures, out_option
from palpate.cli.terminal.output import console, print_json, table
from palpate.physics.errors import ArgumentError
from palpate.physics.extras import missing

EXAMPLE = "palpate build fingertip scan/ -o finger.npz"


def fingertip(
    scan: Annotated[Path, typer.Argument(help="DICOM folder, or .nii(.gz).")],
    out: Annotated[Path, out_option("File to write.")] = Path("finger.npz"),
    spacing: Annotated[str, typer.Option(help="Slice,row,column spacing in mm, such as 1.2,0.23,0.23.")] = "",
    skin: Annotated[
        float | None, typer.Option(help="Thickness of the skin in mm, if the images do not show it.")
    ] = None,
    axes: Annotated[
        str,
        typer.Option(
            help="Directions of slices, rows, columns: T/H to tip or hand, N/P to nail or pulp, R/L seen from the tip,"
            " nail up. By default those of the header."
        ),
    ] = "",
    no_pictures: NoPictures = False,
    as_json: Json = False,
) -> None:
    """Build a fingertip from images of a finger.

    Finds skin, tissue and bone, and writes the file that a beam bundle reads, with a picture of it.
    """
    if not scan.exists():
        raise typer.BadParameter(f"{scan}: no such file or folder", param_hint="SCAN")
    if out.suffix != ".npz":
        raise typer.BadParameter(f"found {out}, expected a name that ends in .npz", param_hint="--out")
    if skin is not None and not 0.1 <= skin <= 4:
        raise typer.BadParameter(f"found {skin} mm, expected 0.1 ... 4", param_hint="--skin")
    if not out.absolute().parent.is_dir():
        raise typer.BadParameter(f"{out.parent}: no such folder", param_hint="--out")
    known_spacing = _spacing(spacing)
    try:
        from palpate.models.scan import read, segment
        from palpate.models.scan.rebuild import measures, of_images, reconstruct
        from palpate.views.pictures.models.scan import draw_scan
    except ImportError as error:
        raise ArgumentError(missing("images of a finger", error.name, "scan")) from None
    stack = read(scan, known_spacing, axes)
    outlines = segment(stack, None if skin is None else skin * 1e-3)
    tip, frame = reconstruct(outlines)
    tip.save(out)
    picture = None if no_pictures else out.with_suffix(".png")
    if picture is not None:
        draw_scan(tip, picture, stack, outlines)
    files = {"output": str(out), "picture": picture and str(picture)}
    report = {"ok": True, **files, **of_images(stack, frame), **measures(tip)}
    if as_json:
        print_json(report)
        return
    _table(report)


def _spacing(text: str) -> tuple[float, float, float] | None:
    if not text:
        return None
    try:
        slice_, row, column = (float(part) * 1e-3 for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"found {text!r}, expected three numbers in mm: 1.2,0.23,0.23",
                                 param_hint="--spacing") from None  # fmt: skip
    return slice_, row, column


def _table(report: dict) -> None:
    rows = []
    for name, value in report.items():
        if name == "ok" or value is None:
            continue
        text = ", ".join(f"{v:g}" for v in value) if isinstance(value, list) else value
        *words, unit = name.split("_")
        unit = {"mm3": "mm³", "deg": "°"}.get(unit, unit)
        label = f"{' '.join(words)} [{unit}]" if unit in ("mm", "mm³", "°") else name.replace("_", " ")
        rows.append((label, f"{text:.2f}" if isinstance(text, float) else str(text)))
    console().print(table(("", ""), rows))
