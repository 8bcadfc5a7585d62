"""`palpate fe`: finite-element runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.launch.commands.common import Json, Verbs, console, tell

if TYPE_CHECKING:
    from palpate.fe.record import Record

fe = typer.Typer(cls=Verbs, no_args_is_help=True, help="Run the full finite-element models.")


@fe.callback()
def _group() -> None:
    """Run the full finite-element models."""


@fe.command()
def fingertip(
    plate: Annotated[str, typer.Option(help="steel or silicone")] = "steel",
    material: Annotated[
        str, typer.Option(help="literal, calibrated, or a number: the divisor of the finger's moduli")
    ] = "calibrated",
    depth: Annotated[float, typer.Option(help="how far the plate rises, mm")] = 2.4,
    cells: Annotated[int, typer.Option(help="elements across an eighth of the circumference")] = 6,
    friction: Annotated[float, typer.Option(help="Coulomb's coefficient")] = 0.2,
    folder: Annotated[Path, typer.Option("--to", help="folder for the results; a broken run goes on there")] = Path(
        "runs/fingertip"
    ),
    as_json: Json = False,
) -> None:
    """Press the layered fingertip on a plate: force, contact area and isostrain volumes; fields as VTK."""
    from rich.progress import Progress, TextColumn

    from palpate.fe.fingertip import CALIBRATED, Fingertip, Pressing
    from palpate.fe.record import record
    from palpate.fe.vtk import write_vtu
    from palpate.nodes.base import SettingError

    named = {"literal": 1.0, "calibrated": CALIBRATED}
    try:
        divisor = named[material] if material in named else float(material)
    except ValueError:
        raise SettingError(f"--material {material}: expected literal, calibrated or a number") from None
    run = folder / f"{plate}-{material}-{cells}-{friction:g}"
    try:
        pressing = Pressing(Fingertip(cells=cells), plate, divisor, friction)
    except ValueError as error:
        raise SettingError(str(error)) from None
    count = 3 * len(pressing.solver.mesh.points)
    columns = (*Progress.get_default_columns()[:3], TextColumn("{task.fields[note]}"))
    with Progress(*columns, console=console(stderr=True), disable=as_json) as bar:
        task = bar.add_task("pressing", total=depth, note=f"{count} degrees of freedom")

        def tick(load: float) -> None:
            bar.update(task, completed=1e3 * load, note=f"{1e3 * load:.2f} mm, {pressing.force:.3g} N")

        found = record(pressing, 1e-3 * depth, run, tick)
    values, _ = pressing.strain()
    finger = pressing.finger.mesh
    moved = pressing.solver.displacement[: len(finger.points)]
    write_vtu(run / "finger.vtu", finger, {"displacement": moved}, {"equivalent_strain": values.mean(axis=1)})
    if as_json:
        tell(_numbers(plate, divisor, found) | {"folder": str(run)})
    else:
        _show(plate, divisor, found)
        console().print(f"{run / 'finger.vtu'}: displacement and equivalent strain")


@fe.command()
def table(
    steel: Annotated[Path, typer.Argument(help="folder of a literal run on steel, of `palpate fe fingertip`")],
    silicone: Annotated[Path, typer.Argument(help="folder of a calibrated run on silicone")],
    to: Annotated[Path, typer.Option("--to", help="file to write")] = Path("fingertip.npz"),
) -> None:
    """Write the table that tactile.Flow reads: area and isostrain volumes against force for both plates."""
    import numpy as np

    from palpate.fe.fingertip import CALIBRATED
    from palpate.fe.record import LEVELS, read_record

    found = {"steel": read_record(steel).softened(CALIBRATED), "silicone": read_record(silicone)}
    data = {"levels": LEVELS}
    for plate, run in found.items():
        keep = np.concatenate([[True], np.diff(run.force) > 0])
        data |= {f"{plate}.{n}": getattr(run, n)[keep] for n in ("force", "area", "volumes", "indentation")}
    np.savez_compressed(to, allow_pickle=False, **data)
    console().print(f"{to}: {', '.join(f'{p} to {r.force[-1]:.3g} N' for p, r in found.items())}")


def _numbers(plate: str, divisor: float, found: Record) -> dict[str, Any]:
    """The record as plain data, with the paper's points beside it."""
    from palpate.fe.fingertip import PAPER

    return {
        "plate": plate,
        "divisor": divisor,
        "indentation": found.indentation.tolist(),
        "force": found.force.tolist(),
        "area": found.area.tolist(),
        "levels": found.levels.tolist(),
        "volumes": found.volumes.tolist(),
        "paper": [
            {"force": f, "indentation": d, "found": found.at(f)[0] if f <= found.force[-1] else None}
            for f, d in PAPER[plate]
        ],
    }


def _show(plate: str, divisor: float, found: Record) -> None:
    from rich.table import Table

    from palpate.fe.fingertip import PAPER

    out = console()
    table = Table(box=None, pad_edge=False, title=f"{plate}, moduli / {divisor:g}", title_justify="left")
    for name in ("indentation mm", "force N", "area mm²", *(f"V({x:g}) mm³" for x in found.levels)):
        table.add_column(name, justify="right")
    for k in range(0, len(found.force), max(1, len(found.force) // 15)):
        row = (1e3 * found.indentation[k], found.force[k], 1e6 * found.area[k], *(1e9 * found.volumes[k]))
        table.add_row(*(f"{x:.4g}" for x in row))
    out.print(table)
    for force, depth in PAPER[plate]:
        if force > found.force[-1]:
            out.print(f"{force} N: not reached (paper: {1e3 * depth:.2f} mm)")
        else:
            out.print(f"{force} N: {1e3 * found.at(force)[0]:.2f} mm (paper: {1e3 * depth:.2f} mm)")
