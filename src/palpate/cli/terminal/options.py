"""Options shared by several commands, and the run that they describe."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.terminal.output import write

if TYPE_CHECKING:
    from palpate.launch.load.launchfile import LaunchFile
    from palpate.launch.load.organ_file import OrganFile


def _names(incomplete: str) -> list[str]:
    from palpate.launch.load.launchfile import names

    return [name for name in names() if name.startswith(incomplete)]


def _as_json(context: typer.Context, value: bool) -> bool:
    context.find_root().meta["palpate.json"] = value
    return value


def instant(text: str) -> float:
    """A time as in launch files, in s: 2, '1200 ms', 0. BadParameter: not a time."""
    from palpate.units.quantity import UnitError, convert

    try:
        return convert(text, "s")
    except UnitError as error:
        raise typer.BadParameter(str(error)) from None


def seconds(text: str) -> float:
    """A duration in s. BadParameter: not a duration, or out of range."""
    duration = instant(text)
    if not 1e-9 <= duration <= 1e9:
        raise typer.BadParameter(f"found {text!r}; expected a time from 1e-9 to 1e9 s")
    return duration


def out_option(help: str) -> Any:
    """The option for the file or the folder to write."""
    return typer.Option("-o", "--out", help=help)


Graph = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped graph, or the path of a graph or launch file.", autocompletion=_names, metavar="GRAPH"
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", help="Set one value: tissue.stiffness=200, scene.finger.thickness='3 mm', rate=500."),
]
SceneOption = Annotated[str | None, typer.Option("--scene", help="Scene to use instead of the graph's.")]
PlaceOption = Annotated[
    str | None,
    typer.Option(
        "--place",
        help="Which nodes share a process: a placement file; apart: one process per node; auto: force path and rest.",
    ),
]
Dialect = Annotated[
    str, typer.Option("--dialect", help="decimal-comma or decimal-point, if the file leaves it open (1,234).")
]
OrganOption = Annotated[
    Path | None,
    typer.Option(
        "--organ", help="Organ instead of the scene's: mesh (.stl, .ply, .obj), segmentation (.nii.gz, .nrrd ...)."
    ),
]
UnitOption = Annotated[
    str | None, typer.Option("--unit", help="Unit of the mesh file: m, cm or mm; required if several are plausible.")
]
PieceOption = Annotated[
    str | None,
    typer.Option(
        "--piece", help="Separate piece of the mesh file: 1, the largest, 2 ..., or all; else all but islands."
    ),
]
LabelOption = Annotated[
    str | None, typer.Option("--label", help="Label of the segmentation: number or name; required if it has several.")
]
RepairOption = Annotated[
    bool, typer.Option("--repair", help="Repair the mesh first; a closed copy is written next to the file.")
]
File = Annotated[Path, typer.Argument(help="Recording (.mcap).", metavar="FILE")]
Port = Annotated[int, typer.Option(help="Port of the page; 0: any free port.", min=0, max=65535)]
Host = Annotated[
    str, typer.Option(help="Address to listen on; 0.0.0.0: a phone or tablet can open the page. Not encrypted.")
]
NoOpen = Annotated[bool, typer.Option("--no-open", help="Do not open the browser.")]
ColourOption = Annotated[
    str, typer.Option("--colour", help="displacement, pressure, slip or strain (largest of the surface's triangles).")
]
Fused = Annotated[bool, typer.Option("--fused", help="Run all nodes in one process.")]


def trust_packages(packages: list[str] | None) -> list[str] | None:
    """Callback of `--trust`: the packages that files and launchers elsewhere may name in this call."""
    from palpate.engine.imports import trust_only

    trust_only(packages or ())
    return packages


Trust = Annotated[
    list[str] | None,
    typer.Option(
        "--trust",
        help="Import this package if the recording names it; by default only code of palpate runs. May be repeated.",
        metavar="PACKAGE",
        callback=trust_packages,
    ),
]
Duration = Annotated[
    float | None,
    typer.Option(
        parser=seconds, metavar="TIME", help="Duration on the graph's clock: seconds, or with a unit: '800 ms'."
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")]
NoPictures = Annotated[bool, typer.Option("--no-pictures", help="Draw no pictures.")]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="No live view and no tables: one line with the outcome, and warnings.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.", callback=_as_json, is_eager=True)]


def choose_launch(
    graph: str, sets: list[str] | None = None, scene: str | None = None, place: str | None = None, fused: bool = False
) -> LaunchFile:
    """The run that the options describe. GraphError: an option is invalid."""
    from palpate.launch.load.launchfile import find
    from palpate.launch.load.placement import FUSED, find_place

    if fused and place not in (None, FUSED):
        raise typer.BadParameter(
            f"--fused puts everything in one process, --place {place} contradicts it: use one of them"
        )
    launch = find(graph).but(
        overrides=sets or (), scene=scene and Path(scene), place=FUSED if fused else find_place(place)
    )
    if launch.organ is None:
        return launch
    from palpate.launch.run.progress import preparing

    with preparing():
        return launch.settle_organ()


def check_new(files: Collection[Path], force: bool) -> None:
    """ArgumentError: a file exists, and `force` is not set. OSError: it cannot be written."""
    from palpate.physics.errors import ArgumentError
    from palpate.physics.writable import check_file

    if kept := [str(file) for file in files if not force and file.exists()]:
        raise ArgumentError(f"{', '.join(kept)}: exists; expected another name (-o), or --force")
    for file in files:
        check_file(file)


ENDINGS = (".png", ".svg", ".pdf")  # of pictures


def check_ending(target: Path, endings: tuple[str, ...] = ENDINGS) -> None:
    """BadParameter: a picture of this name cannot be written."""
    if target.suffix.lower() not in endings:
        raise typer.BadParameter(f"{target}: found {target.suffix or 'no ending'!r}, expected {' or '.join(endings)}")


def launch_file(launch: LaunchFile, out: Path | None, what: str) -> Path:
    """The launch file to write, by default runs/GRAPH-WHAT.yaml. OSError: it cannot be written."""
    from palpate.physics.writable import check_file

    file = out or Path("runs", f"{(launch.path or launch.graph).stem}-{what}.yaml")
    check_file(file)
    return file


def organ_file(
    file: Path | None,
    unit: str | None,
    piece: str | None,
    repair: bool,
    silent: bool = False,
    label: str | None = None,
) -> tuple[OrganFile | None, tuple[str, ...]]:
    """The organ of `--organ`, `--unit`, `--piece`, `--label` and `--repair`, and notes on its repair; None: not given.
    MeshError, SettingError: unusable organ."""
    if file is None:
        for option, given in (("--unit", unit), ("--piece", piece), ("--label", label), ("--repair", repair)):
            if given:
                raise typer.BadParameter(f"{option} needs --organ FILE")
        return None, ()
    from palpate.launch.load.organ_file import OrganFile

    if piece not in (None, "all") and not str(piece).isdecimal():
        raise typer.BadParameter(f"--piece: found {piece!r}, expected all or a number from 1")
    organ = OrganFile(file, unit, int(piece) if piece is not None and piece.isdecimal() else piece, label)
    if not repair:
        return organ, ()
    from palpate.models.build.repair import repair_mesh

    if organ.labelled().parts:
        raise typer.BadParameter(
            f"--repair: found --label {label}, expected one label; a repaired mesh has no nodule and no bone"
        )
    organ, made = organ.as_mesh()
    if not silent:
        write(f"repairing {file} ...", err=True)
    written, steps = repair_mesh(organ.file, organ.in_unit(), organ.setting)
    text = f"{file}: {', '.join(steps)}; written to {written}" if steps else f"{file} needs no repair"
    return (OrganFile(written, "m") if steps else organ), (*made, text)


def say_organ_file(
    file: Path | None,
    unit: str | None,
    piece: str | None,
    repair: bool,
    silent: bool = False,
    label: str | None = None,
) -> OrganFile | None:
    """The organ of `organ_file`; its notes are printed."""
    organ, notes = organ_file(file, unit, piece, repair, silent, label)
    for line in () if silent else notes:
        write(line, err=True)
    return organ


def with_organ_file(
    launch: LaunchFile,
    file: Path | None,
    unit: str | None,
    piece: str | None,
    repair: bool,
    silent: bool = False,
    label: str | None = None,
) -> LaunchFile:
    """Put the organ of a file, or of the launch file or scene, in the place of the run's organ. MeshError,
    SettingError: unusable organ."""
    organ, notes = organ_file(file, unit, piece, repair, silent, label)
    launch = dataclasses.replace(launch.but(organ=organ), notes=(*launch.notes, *notes))
    if launch.organ is not None:
        from palpate.launch.run.progress import preparing

        with preparing(silent):
            launch = launch.settle_organ()
    else:
        launch = launch.settle_organ()
    for line in () if silent else launch.notes:
        write(line, err=True)
    return launch


def recorded_to(
    launch: LaunchFile,
    name: str,
    record: Path | None,
    out: Path | None,
    no_record: bool,
    only: str | None,
    ending: contextlib.ExitStack,
) -> tuple[LaunchFile, Path | None]:
    """The run with the file of its recording, and the folder of its pictures; None: not recorded. `ending` removes a
    new folder that stays empty."""
    from palpate.launch.load.launchfile import RECORDED
    from palpate.launch.load.recording import new_folder, recording_name

    one_of("--record-only", only, *RECORDED)
    if record is not None:
        recording_name(record, "--record")
    if no_record or (record is None and out is None and launch.record is None):
        return dataclasses.replace(launch.but(only=only), record=None), None
    folder = out or (record.parent if record else ending.enter_context(new_folder(name)))
    file = record or folder / (launch.record.name if launch.record else f"{name}.mcap")
    return dataclasses.replace(launch.but(only=only), record=file), folder


def reconnecting(launch: LaunchFile) -> LaunchFile:
    """Let all device nodes of a run reconnect. BadParameter: the graph has none."""
    from palpate.nodes.base import settings

    devices = [name for name, spec in launch.load().nodes.items() if "reconnect" in settings(spec.cls)]
    if not devices:
        raise typer.BadParameter("--reconnect: no node of this graph drives a device that can be reconnected")
    return launch.but(overrides=[f"{name}.reconnect=true" for name in devices])


def thin_factors(given: list[str]) -> dict[str, int]:
    """Parse texts STREAM=N. BadParameter: another text."""
    factors = {}
    for text in given:
        stream, _, number = text.partition("=")
        if not number.isdecimal() or int(number) < 1:
            raise typer.BadParameter(f"--thin: found {text!r}, expected STREAM=N with N from 1")
        factors[stream] = int(number)
    return factors


def one_of(option: str, value: str | None, *words: str) -> None:
    """BadParameter: the value of an option is not one of these words."""
    if value not in (None, *words):
        raise typer.BadParameter(f"{option}: found {value!r}, expected {' or '.join(words)}")
