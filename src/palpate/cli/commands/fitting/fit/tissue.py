"""`palpate fit tissue PRESS.csv ...`: fit the parameters of a material to measured presses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal.fitted import RIGS, rig_of, show_fit, show_fits
from palpate.cli.terminal.options import Dialect, Force, Json, check_new, out_option
from palpate.cli.terminal.pooled import fit_sparse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from palpate.models.fit.tissue.measured import MeasuredPress

EXAMPLE = "palpate fit tissue press.csv --rig ball --radius '8 mm' --law hertz -o fit"


def tissue(
    files: Annotated[
        list[Path],
        typer.Argument(help="CSV files or recordings (.mcap) of presses by one rig.", metavar="PRESS.csv..."),
    ],
    rig: Annotated[str, typer.Option(help=f"What pressed: {', '.join(RIGS)} (between plates)")],
    law: Annotated[
        str, typer.Option(help="hertz, layer, exponential, power; ogden, demiray, yeoh, yeoh3, neo_hooke, ...")
    ],
    columns: Annotated[
        str,
        typer.Option(
            help="Names or numbers of columns: time=t,force=F,indentation=3; force=-F inverts the sign. specimen=Batch "
            "names the specimens, specimen= fits all as one."
        ),
    ] = "",
    unit: Annotated[list[str] | None, typer.Option(help="Unit of a column whose header has none: d=mm.")] = None,
    dialect: Dialect = "",
    radius: Annotated[str | None, typer.Option(help="Radius of the ball or punch: '8 mm'.")] = None,
    diameter: Annotated[str | None, typer.Option(help="Diameter of the ball, punch or cylinder.")] = None,
    height: Annotated[str | None, typer.Option(help="Height of the cylinder or of the layer.")] = None,
    plates: Annotated[str, typer.Option(help="Plates: frictionless or bonded.")] = "frictionless",
    poisson: Annotated[
        float, typer.Option(help="Poisson's ratio; a press does not determine it.", min=0, max=0.5)
    ] = 0.5,
    relaxation: Annotated[str, typer.Option(help="none, kelvin-voigt, hunt-crossley, prony:1 ... prony:3.")] = "none",
    holdout: Annotated[list[Path] | None, typer.Option(help="A press that is predicted, not fitted.")] = None,
    compare: Annotated[
        list[str] | None, typer.Option(help="Another law, fitted to the same rows and ranked by AICc.")
    ] = None,
    touch: Annotated[str, typer.Option(help="Contact point: fit, or detected (from the force alone).")] = "fit",
    drift: Annotated[str, typer.Option(help="How the sensor's zero may drift: curved, linear or none.")] = "curved",
    depth_limit: Annotated[str | None, typer.Option(help="Leave out rows deeper than this: '5 mm'.")] = None,
    out: Annotated[Path, out_option("Folder for scene, report and pictures.")] = Path("fit"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fit a material to measured presses: force over indentation.

    Writes scene.yaml, which is ready to run, report.md with pictures, and report.json: parameters with 95 % intervals,
    parameters that the data do not determine, fixed parameters, and the error on held-out presses. Specimens that a
    column names are fitted one by one, each to its folder.
    """
    import math

    from palpate.launch.run.progress import steps
    from palpate.models.fit.sessions import SessionError
    from palpate.models.fit.tissue import fit as fits
    from palpate.models.fit.tissue.report import WRITTEN
    from palpate.models.fit.tissue.several import SpecimenFits, by_specimen, fit_each, folders_of
    from palpate.studies.presses import PressReader, length

    # Check the options before any file is read.
    made = rig_of(rig, radius, diameter, height, plates, poisson)
    if touch not in ("fit", "detected"):
        raise SessionError(f"--touch: found {touch!r}, expected fit, detected")
    fits.check_laws(made, (law, *(compare or ())), relaxation, drift)
    check_new([out / name for name in WRITTEN], force)
    # Read the presses and fit the law.
    read = PressReader(columns.split(","), unit or [], rig == "fingertip", dialect)
    limit = length("--depth-limit", depth_limit) if depth_limit else math.inf
    if len(files) == 1 and (probes := read.probes(files[0])) is not None:
        if made.kind not in ("ball", "punch") or relaxation != "none" or compare or holdout:
            raise SessionError(f"{files[0]}: {len(probes.names)} sparse probes are fitted together: expected --rig "
                               "ball or punch, without --relaxation, --compare and --holdout")  # fmt: skip
        fit_sparse(probes, made, law, limit, out, as_json)
        return
    groups = by_specimen([p for file in files for p in read(file)])
    others = [p for file in holdout or [] for p in read(file)]
    if len(groups) > 1:
        check_new([out / name / one for name in folders_of(groups).values() for one in WRITTEN], force)
    with steps(f"fit tissue: {law}", len(groups), silent=as_json, timed=False) as done:

        def fit(label: str, part: Sequence[MeasuredPress], held_out: Sequence[MeasuredPress]) -> fits.TissueFit:
            done(f"specimen {label}" if label else "", 0.0)
            return fits.fit_tissue(
                part, made, law, relaxation, held_out=held_out, compare=compare or (), touch=touch == "fit",
                deepest=limit, drift=drift, report=lambda share: done("presses in finite elements", share),
            )  # fmt: skip

        found = fit_each(groups, others, fit) if len(groups) > 1 else fit("", groups[""], others)
    if isinstance(found, SpecimenFits):
        show_fits(found, out, as_json)
    else:
        show_fit(found, out, as_json)
