"""`palpate fe`: finite-element runs."""

from __future__ import annotations

from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import INTERRUPTED, Json, console, tell
from palpate.launch.commands.fe_report import numbers, show, show_statements
from palpate.launch.load.extras import install

if TYPE_CHECKING:
    from palpate.models.fe.meshing.layers import Layers
    from palpate.models.fe.study.press_record import PressRun, Record
    from palpate.models.fe.study.pressing import Pressing

fe = typer.Typer(no_args_is_help=True, help="Run the full finite-element models.")


@fe.callback()
def _group() -> None:
    """Run the full finite-element models."""


@fe.command()
def fingertip(
    plate: Annotated[str, typer.Option(help="steel or silicone")] = "steel",
    material: Annotated[
        str,
        typer.Option(
            help="printed, calibrated (printed / 16.3), cortical (bone of 17 GPa), one of these with a divisor as in "
            "cortical/36.4, or a number: the divisor of the printed moduli"
        ),
    ] = "calibrated",
    depth: Annotated[float, typer.Option(help="travel of the plate, mm")] = 2.4,
    cells: Annotated[int, typer.Option(help="elements across an eighth of the circumference")] = 6,
    friction: Annotated[float, typer.Option(help="Coulomb's coefficient")] = 0.2,
    finger: Annotated[
        Path | None, typer.Option(help="a measured finger instead of the paper's, of `palpate fingertip SCAN -o FILE`")
    ] = None,
    folder: Annotated[Path, typer.Option("--to", help="folder of results; an interrupted run continues")] = Path(
        "runs/fingertip"
    ),
    as_json: Json = False,
) -> None:
    """Press the layered fingertip on a plate: force, contact area, isostrain volumes; fields as VTK; pictures."""
    _check_material(material)
    tip = _finger(finger, cells)
    _check_depth(depth, tip)
    place = folder / run_name(plate, material, cells, friction, finger)
    pressing, run = _pressing(tip, plate, material, friction, place)
    record = _press(pressing, 1e-3 * depth, run, as_json)
    _fields(pressing, place / "finger.vtu")
    made = _pictures({plate: run}, place)
    if as_json:
        data = {"ok": True} | numbers(plate, material, record, finger is None)
        tell(data | {"folder": str(place), "pictures": [str(path) for path in made]})
        return
    show(plate, material, record, finger is None)
    typer.echo(f"{place / 'finger.vtu'}: displacement, equivalent strain and contact pressure")
    for path in made:
        typer.echo(path)


@fe.command()
def compare(
    steel: Annotated[Path, typer.Argument(help="folder of a run on steel, of `palpate fe fingertip`")],
    silicone: Annotated[Path, typer.Argument(help="folder of a run on silicone")],
    to: Annotated[Path, typer.Option("--to", help="folder for the pictures")] = Path("runs/fingertip"),
    as_json: Json = False,
) -> None:
    """Compare both plates: which of the paper's statements hold, and pictures like its Figures 3 to 5."""
    from palpate.models.fe.study.paper_claims import statements
    from palpate.models.fe.study.press_record import PressRun

    runs = {"steel": PressRun(steel), "silicone": PressRun(silicone)}
    _check_pair(runs)
    rows = statements(*(run.record() for run in runs.values()))
    to.mkdir(parents=True, exist_ok=True)
    made = _pictures(runs, to)
    if as_json:
        tell({"ok": True, "statements": rows, "pictures": [str(path) for path in made]})
        return
    show_statements(rows)
    for path in made:
        typer.echo(path)


@fe.command()
def table(
    steel: Annotated[Path, typer.Argument(help="folder of a run on steel, of `palpate fe fingertip`")],
    silicone: Annotated[Path, typer.Argument(help="folder of a run on silicone with the same material")],
    to: Annotated[Path, typer.Option("--to", help="file to write")] = Path("fingertip.npz"),
    as_json: Json = False,
) -> None:
    """Write the table that tactile.Flow reads: area and isostrain volumes against force for both plates.

    A steel run with another divisor is scaled: on a rigid plate the force is proportional to the moduli.
    """
    import numpy as np

    from palpate.models.fe.study.press_record import LEVELS, PressRun
    from palpate.physics.errors import ArgumentError

    runs = {"steel": PressRun(steel), "silicone": PressRun(silicone)}
    ratio = _check_pair(runs, scaled=True)
    if to.suffix != ".npz":
        raise ArgumentError(f"--to {to}: expected a name that ends in .npz")
    records = {"steel": runs["steel"].record().softened(ratio), "silicone": runs["silicone"].record()}
    data = {"levels": LEVELS}
    for plate, record in records.items():
        keep = np.concatenate([[True], np.diff(record.force) > 0])
        data |= {f"{plate}.{n}": getattr(record, n)[keep] for n in ("force", "area", "volumes", "indentation")}
    np.savez_compressed(to, allow_pickle=False, **data)
    if as_json:
        tell({"ok": True, "table": str(to), "force": {p: r.force[-1] for p, r in records.items()}})
    else:
        typer.echo(f"{to}: {', '.join(f'{p} to {r.force[-1]:.3g} N' for p, r in records.items())}")


@fe.command()
def laws(as_json: Json = False) -> None:
    """List the material laws: equation, and moduli at small strain of an example."""
    from palpate.physics.materials.hyperelastic import constructor, example, rest_moduli
    from palpate.physics.materials.hyperelastic import laws as every

    rows = []
    for name, module in every().items():
        shear, bulk = rest_moduli(example(name))
        made = f"{name}{signature(constructor(name))}".split(" ->")[0].replace(": 'float'", "")
        text = (module.__doc__ or "").strip()
        rows.append({"law": name, "make": made, "example": list(module.EXAMPLE), "shear Pa": shear, "bulk Pa": bulk}
                    | {"text": text})  # fmt: skip
    if as_json:
        tell({"ok": True, "laws": rows})
        return
    for row in rows:
        typer.secho(str(row["make"]), bold=True)
        typer.echo(f"{row['text']}\n\nat rest with {row['example']}: shear modulus {row['shear Pa']:.4g} Pa, bulk "
                   f"modulus {row['bulk Pa']:.4g} Pa\n")  # fmt: skip


def run_name(plate: str, material: str, cells: int, friction: float, finger: Path | None = None) -> str:
    """Of the folder in which a run keeps its results."""
    return f"{plate}-{material.replace('/', '-by-')}-{cells}-{friction:g}" + (
        "" if finger is None else f"-{finger.stem}"
    )


def _check_material(material: str) -> None:
    from palpate.models.fe.element.mesh import MeshError
    from palpate.models.fe.meshing.fingertip import divisor_and_bone

    try:
        divisor_and_bone(material)
    except MeshError as error:
        raise MeshError(f"--{error}") from None


def _finger(path: Path | None, cells: int) -> Layers:
    from palpate.models.fe.element.mesh import MeshError
    from palpate.models.fe.meshing.fingertip import FingertipDimensions
    from palpate.models.fe.meshing.scanned import Scanned
    from palpate.physics.fingertip import surfaces as measured

    if not 3 <= cells <= 20:
        raise MeshError(f"--cells {cells}: expected 3 ... 20")
    if path is None:
        return FingertipDimensions(cells=cells)
    return Scanned(measured.FingertipSurfaces.load(path), cells=cells)


def _check_depth(depth: float, tip: Layers) -> None:
    from palpate.models.fe.element.mesh import MeshError

    most = 1e3 * float(tip.radii[-1] - tip.radii[0])
    if not 0.0 < depth < most:
        raise MeshError(f"--depth {depth:g}: expected more than 0 and less than {most:.2f} mm, from skin to bone")


def _pressing(tip: Layers, plate: str, material: str, friction: float, place: Path) -> tuple[Pressing, PressRun]:
    """The pressing, and its folder, which can be written."""
    from palpate.models.fe.element.mesh import MeshError
    from palpate.models.fe.study.press_record import PressRun
    from palpate.models.fe.study.pressing import Pressing

    try:
        pressing = Pressing(tip, plate, material, friction)
    except MeshError:
        raise
    except ValueError as error:
        raise MeshError(f"--{error}") from None
    place.mkdir(parents=True, exist_ok=True)
    (place / "next").write_bytes(b"")
    (place / "next").unlink()
    return pressing, PressRun(place)


def _press(pressing: Pressing, end: float, run: PressRun, quiet: bool) -> Record:
    """The pressing, with a bar; Ctrl-C keeps what is done."""
    from rich.progress import Progress, TextColumn

    from palpate.models.fe.study.press_record import record

    count = 3 * len(pressing.solver.mesh.points)
    columns = (*Progress.get_default_columns()[:3], TextColumn("{task.fields[note]}"))
    bar = Progress(*columns, console=console(stderr=True), disable=quiet)
    task = bar.add_task("pressing", total=1e3 * end, note=f"{count} degrees of freedom")

    def tick(load: float) -> None:
        bar.start()  # not before the folder has been read, so that what is wrong with it stands alone
        bar.update(task, completed=1e3 * load, note=f"{1e3 * load:.2f} mm, {pressing.force:.3g} N")

    try:
        return record(pressing, end, run, tick)
    except KeyboardInterrupt:
        bar.stop()
        done = f"stopped at {1e3 * pressing.solver.load:.2f} mm; the same command continues from there ({run.folder})"
        typer.secho(done, fg="red", err=True)
        raise typer.Exit(INTERRUPTED) from None
    finally:
        bar.stop()


def _fields(pressing: Pressing, path: Path) -> None:
    from palpate.models.fe.contact.pressure import nodal_pressure
    from palpate.models.fe.element.vtk import write_vtu

    values = pressing.strain()
    mesh = pressing.finger.mesh
    moved = pressing.solver.displacement[: len(mesh.points)]
    pressure = nodal_pressure(pressing.touch, pressing.solver.displacement)[: len(mesh.points)]
    write_vtu(path, mesh, {"displacement": moved, "pressure": pressure}, {"equivalent_strain": values.mean(axis=1)})


def _pictures(runs: dict[str, PressRun], folder: Path) -> list[Path]:
    """The pictures, or a line that says what is missing."""
    from palpate.views.pictures.fe_fingertip import draw

    try:
        return draw(runs, folder)
    except ModuleNotFoundError as error:
        typer.secho(f"{error.name} is not installed, so no pictures. {install('view')}", err=True)
        return []


def _check_pair(runs: dict[str, PressRun], scaled: bool = False) -> float:
    """Whether the runs are of one finger on these plates; the ratio of the divisors, which is 1 unless it may be
    scaled. ArgumentError: they are not."""
    from palpate.models.fe.study.press_record import differing
    from palpate.physics.errors import ArgumentError

    run_settings = {plate: run.settings() for plate, run in runs.items()}
    for plate, settings in run_settings.items():
        if settings.get("plate") != plate:
            raise ArgumentError(f"{runs[plate].folder}: a run on {settings.get('plate')}, expected one on {plate}")
    hard, soft = ({k: v for k, v in s.items() if k != "plate"} for s in run_settings.values())
    ratio = float(soft["divisor"]) / float(hard["divisor"])
    if scaled:
        hard |= {"divisor": soft["divisor"]}
    other = differing(hard, soft)
    if other is not None:
        raise ArgumentError(f"{other[0]} is {other[1]} on steel, {other[2]} on silicone; expected the same in both")
    return ratio
