"""`palpate build fe fingertip`: press the layered fingertip on a plate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import console, print_json, say, table, write

if TYPE_CHECKING:
    from palpate.models.fe.study.press_record import PressRun, Record
    from palpate.models.fe.study.pressing import Pressing

EXAMPLE = "palpate build fe fingertip --plate steel --depth 1.5"
RUNS = Path("runs/fingertip")


def fingertip(
    plate: Annotated[str, typer.Option(help="steel or silicone.")] = "steel",
    material: Annotated[
        str,
        typer.Option(
            help="printed, calibrated (printed / 16.3) or cortical (bone of 17 GPa), all with a divisor: cortical/36.4"
        ),
    ] = "calibrated",
    depth: Annotated[float, typer.Option(help="Travel of the plate, mm.")] = 2.4,
    cells: Annotated[int, typer.Option(help="Elements across an eighth of the circumference.")] = 6,
    friction: Annotated[float, typer.Option(help="Coulomb's coefficient.")] = 0.2,
    out: Annotated[Path, out_option("Folder; an interrupted run resumes.")] = RUNS,
    as_json: Json = False,
) -> None:
    """Press the layered fingertip on a plate, and write force, area and volumes."""
    from palpate.models.fe.study.press_record import PressRun, numbers
    from palpate.physics.extras import missing
    from palpate.physics.writable import check_folder

    pressing = _pressing(plate, material, depth, cells, friction)
    place = out / f"{plate}-{material.replace('/', '-by-')}-{cells}-{friction:g}"
    check_folder(place)
    place.mkdir(parents=True, exist_ok=True)
    record = _press_model(pressing, 1e-3 * depth, PressRun(place), as_json)
    fields = place / "finger.vtu"
    try:
        pressing.write(fields)
    except ModuleNotFoundError as error:
        say(missing(f"no {fields.name}", error.name, "mesh"), err=True)
    if as_json:
        print_json({"ok": True} | numbers(plate, material, record) | {"folder": str(place)})
        return
    _print(plate, material, record)
    if fields.exists():
        write(f"{fields}: displacement, equivalent strain and contact pressure")


def _pressing(plate: str, material: str, depth: float, cells: int, friction: float) -> Pressing:
    """The press that the options describe. MeshError: an option is invalid."""
    from palpate.models.fe.element.mesh import MeshError
    from palpate.models.fe.meshing.fingertip import FingertipDimensions, divisor_and_bone
    from palpate.models.fe.study.pressing import Pressing

    try:
        divisor_and_bone(material)
    except MeshError as error:
        raise MeshError(f"--{error}") from None
    if not 3 <= cells <= 20:
        raise MeshError(f"--cells {cells}: expected 3 ... 20")
    tip = FingertipDimensions(cells=cells)
    most = 1e3 * float(tip.radii[-1] - tip.radii[0])
    if not 0.0 < depth < most:
        raise MeshError(f"--depth {depth:g}: expected more than 0 and less than {most:.2f} mm, from skin to bone")
    try:
        return Pressing(tip, plate, material, friction)
    except ValueError as error:
        raise error if isinstance(error, MeshError) else MeshError(f"--{error}") from None


def _press_model(pressing: Pressing, end: float, run: PressRun, quiet: bool) -> Record:
    from palpate.launch.run.progress import StageBars
    from palpate.models.fe.study.press_record import record

    with StageBars(quiet) as stages:
        done = stages.begin("pressing", f"{3 * len(pressing.solver.mesh.points)} degrees of freedom")
        try:
            return record(
                pressing, end, run, lambda load: done(load / end, f"{1e3 * load:.2f} mm, {pressing.force:.3g} N")
            )
        except KeyboardInterrupt as error:
            at = f"{1e3 * pressing.solver.load:.2f} mm"
            error.add_note(f"pressed to {at}; the same command continues from there ({run.folder})")
            raise


def _print(plate: str, material: str, record: Record) -> None:
    from palpate.models.fe.meshing.fingertip import PAPER, divisor_and_bone

    divisor, bone = divisor_and_bone(material)
    heads = (">mm", ">N", ">mm²", *(f">V({x:g})" for x in record.levels))
    rows = (
        (1e3 * record.indentation[k], record.force[k], 1e6 * record.area[k], *(1e9 * record.volumes[k]))
        for k in range(0, len(record.force), max(1, len(record.force) // 15))
    )
    cells = ([f"{x:.3g}" if x < 1000 else f"{x:.0f}" for x in row] for row in rows)
    title = f"{plate}, moduli / {divisor:g}, bone {bone / divisor:.3g} Pa; V in mm³ by strain"
    console().print(table(heads, cells, title=title, fixed=heads))
    for force, depth in PAPER[plate]:
        found = f"{1e3 * record.at(force)[0]:.2f} mm" if force <= record.force[-1] else "not reached"
        write(f"{force} N: {found} (paper: {1e3 * depth:.2f} mm)")
