"""`palpate fit tissue PRESS.csv ...`: fit the parameters of a material to measured presses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Dialect, Force, Json, check_new, out_option
from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, table
from palpate.cli.terminal.pooled import fit_sparse
from palpate.physics.archive import replace_text

EXAMPLE = "palpate fit tissue press.csv --rig ball --radius '8 mm' --law hertz -o fit"
RIGS = ("ball", "punch", "fingertip", "cylinder")


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
        str, typer.Option(help="Names or numbers of columns: time=t,force=F,indentation=3; force=-F inverts the sign.")
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
    parameters that the data do not determine, fixed parameters, and the error on held-out presses.
    """
    import math

    from palpate.launch.run.progress import steps
    from palpate.models.fit.sessions import SessionError
    from palpate.models.fit.tissue import fit as fits
    from palpate.models.fit.tissue.report import WRITTEN, data, held_out, markdown, scene, scene_young
    from palpate.models.fit.tissue.rigs import Rig
    from palpate.studies.presses import PressReader, length
    from palpate.views.pictures.models.fit_tissue import draw_fit

    # Check the options before any file is read.
    for option, found, known in (
        ("--rig", rig, RIGS), ("--plates", plates, ("frictionless", "bonded")), ("--touch", touch, ("fit", "detected")),
    ):  # fmt: skip
        if found not in known:
            raise SessionError(f"{option}: found {found!r}, expected {', '.join(known)}")
    size = length("--radius", radius) if radius else 0.5 * length("--diameter", diameter) if diameter else None
    if (radius and diameter) or (rig != "fingertip" and size is None):
        raise SessionError(f"--rig {rig}: expected either --radius or --diameter, such as --radius '8 mm'")
    made = Rig(rig, 8e-3 if size is None else size, length("--height", height) if height else None, plates, poisson)
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
    presses = [p for file in files for p in read(file)]
    others = [p for file in holdout or [] for p in read(file)]
    with steps(f"fit tissue: {law}", 1, silent=as_json, timed=False) as done:
        fit = fits.fit_tissue(
            presses, made, law, relaxation, held_out=others, compare=compare or (), touch=touch == "fit",
            deepest=limit, drift=drift, report=lambda share: done("presses in finite elements", share),
        )  # fmt: skip
    # Write the results, then report them.
    result = data(fit)
    out.mkdir(parents=True, exist_ok=True)
    pictures = draw_if_possible(draw_fit, fit, out)
    replace_text(out / "scene.yaml", scene(fit))
    replace_text(out / "report.json", json.dumps(result, indent=1) + "\n")
    replace_text(out / "report.md", markdown(fit, pictures))
    if as_json:
        print_json({"ok": True, "out": str(out)} | result)
        return
    ends = "withheld" if fit.estimate.withheld else "{low:.4g} to {high:.4g}"
    rows = [(name, f"{p['value']:.5g}", ends.format(**p), str(p["unit"])) for name, p in result["parameters"].items()]
    console().print(table(("parameter", ">value", ">95 % interval", "unit"), rows))
    for text in fit.read:
        say(text, "dim", wrap=True)
    for text in [*(f"not determined: {text}" for text in fit.open_), *fit.notes, *scene_young(fit)]:
        say(text, wrap=True)
    for row in fit.compared:
        say(f"law {row['law']}: RMS {100 * row['rms_of_peak']:.2g} % of the peak, AICc {row['aicc']:.3g} above best")
    for tried in fit.held_out:
        say(held_out(tried), wrap=True)
    say(f"written {out}/report.md, report.json, scene.yaml; next: palpate run kidney --scene {out}/scene.yaml")
