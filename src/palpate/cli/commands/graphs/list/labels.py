"""`palpate list labels`: the labels of a segmentation."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, print_json, say, table

EXAMPLE = "palpate list labels seg.nii.gz"


def labels(
    file: Annotated[Path, typer.Argument(help="Segmentation: .nii, .nii.gz, .nrrd, .mha, .dcm.", metavar="FILE")],
    as_json: Json = False,
) -> None:
    """List the labels of a segmentation: name, volume and extent.

    Each can be an organ: `palpate run kidney --organ FILE --label LABEL`. With `--label liver+tumour` the tumour is a
    nodule in the liver, and "inside" is its modulus over that of the organ; with `--label liver/rib_left_9` the rib is
    rigid and supports the liver.
    """
    from palpate.launch.load.labelled.table import is_bone, ratio_of, tissue_of
    from palpate.physics.segmentation.image import extents
    from palpate.physics.segmentation.read import read_labels

    image = read_labels(file)
    found = [
        {"label": segment.number, "name": segment.name, "voxels": image.count(segment), "volume m3":
         image.volume(segment), "extent m": sides.tolist(), "centre m": centre.tolist(),
         "tissue": tissue_of(segment.name), "ratio inside": (ratio := ratio_of(segment.name, "")) and ratio.value}
        for segment, sides, centre in extents(image)
    ]  # fmt: skip
    spacing = image.spacing.tolist()
    if as_json:
        print_json({"ok": True, "voxel m": spacing, "labels": found, "notes": list(image.notes)})
        return
    rows = [
        (str(each["label"]), each["name"], f"{1e6 * each['volume m3']:.4g}", _mm(each["extent m"], " x "),
         _mm(each["centre m"], ", "), _becomes(each["tissue"], each["ratio inside"], is_bone(each["name"])))
        for each in found
    ]  # fmt: skip
    heads = (">label", "name", ">volume [cm³]", "extent [mm]", "centre: right, front, head [mm]", "becomes")
    console().print(table(heads, rows, fixed=heads[:1]))
    say(f"voxels of {_mm(spacing, ' x ')} mm; palpate run kidney --organ {file} --label LABEL touches one", wrap=True)
    for note in image.notes:
        say(f"{file}: {note}", "yellow", wrap=True)


def _mm(lengths: list[float], between: str) -> str:
    return between.join(f"{1e3 * each:.3g}" for each in lengths)


def _becomes(tissue: str | None, ratio: float | None, bone: bool) -> str:
    """What a label becomes: the published tissue of an organ, the modulus of a part inside of one, or bone."""
    if bone:
        return "rigid next to an organ"
    return tissue or (f"inside: {ratio:g} x the modulus of its organ" if ratio else "")
