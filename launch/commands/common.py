"""What the verbs share: their options, finding what to run, printing, and errors without traceback."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from palpate.physics.errors import MISUSE, TROUBLE, PalpateError

__all__ = ["MISUSE", "TROUBLE"]

if TYPE_CHECKING:
    from rich.console import Console

    from palpate.launch.load.launchfile import LaunchFile

INTERRUPTED = 130
"""Exit code of a run that Ctrl-C ended."""


def _names(incomplete: str) -> list[str]:
    from palpate.launch.load.launchfile import names

    return [name for name in names() if name.startswith(incomplete)]


def _as_json(context: typer.Context, value: bool) -> bool:
    context.find_root().meta["palpate.json"] = value
    return value


Graph = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped launch file or graph, or the path of one.", autocompletion=_names, metavar="GRAPH"
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", help="Set one value: tissue.stiffness=2e3, scene.finger.h0='3 mm', rate=500."),
]
SceneOption = Annotated[str | None, typer.Option("--scene", help="Scene to use instead of the graph's own.")]
PlaceOption = Annotated[
    str | None,
    typer.Option(
        "--place",
        help="Which nodes share a process: a placement file; apart: one process per node; auto: force path and rest.",
    ),
]
OrganOption = Annotated[
    Path | None, typer.Option("--organ", help="Mesh file (.stl, .ply, .obj) in place of the scene's organ.")
]
UnitOption = Annotated[
    str | None, typer.Option("--unit", help="Unit of the mesh file: m, cm or mm; required if several are plausible.")
]
RepairOption = Annotated[
    bool, typer.Option("--repair", help="Repair the mesh first; a closed copy is written next to the file.")
]
Fused = Annotated[bool, typer.Option("--fused", help="Run all nodes in one process.")]


def _trust(packages: list[str] | None) -> list[str] | None:
    from palpate.engine.imports import trust_only

    trust_only(packages or ())
    return packages


Trust = Annotated[
    list[str] | None,
    typer.Option(
        "--trust",
        help="Import this package where the recording names it; else only palpate's own code runs. May be repeated.",
        metavar="PACKAGE",
        callback=_trust,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.", callback=_as_json, is_eager=True)]


def seconds(text: str) -> float:
    """[s] of a time as in launch files: 2, '2 s', '0.5 min'. BadParameter: it is none."""
    from palpate.launch.load.units import UnitError, convert

    try:
        duration = convert(text, "s")
    except UnitError as error:
        raise typer.BadParameter(str(error)) from None
    if not 1e-9 <= duration <= 1e9:
        raise typer.BadParameter(f"found {text!r}; expected a time from 1e-9 to 1e9 s")
    return duration


def chosen(
    graph: str, sets: list[str] | None = None, scene: str | None = None, place: str | None = None, fused: bool = False
) -> LaunchFile:
    """The run that the options describe. GraphError: what is wrong with them."""
    from palpate.launch.load.files import SCENES, find_file
    from palpate.launch.load.launchfile import find
    from palpate.launch.load.placement import FUSED, find_place

    scene_file = None if scene is None else find_file(scene, SCENES, what="scene")
    if fused and place not in (None, FUSED):
        raise typer.BadParameter(
            f"--fused puts everything in one process, --place {place} contradicts it: use one of them"
        )
    return find(graph).but(overrides=sets or (), scene=scene_file, place=FUSED if fused else find_place(place))


def with_own_organ(
    launch: LaunchFile, file: Path | None, unit: str | None, repair: bool, silent: bool = False
) -> tuple[LaunchFile, list[str]]:
    """The run with the organ of a mesh file, and what was done to it. MeshError, SettingError: it cannot be used."""
    if file is None:
        if unit is not None or repair:
            raise typer.BadParameter(f"{'--repair' if repair else '--unit'} needs --organ FILE")
        return launch, []
    from palpate.launch.load.organ import OrganFile, with_organ  # numba and scipy, which few graphs need
    from palpate.launch.load.repair import repaired

    organ, done = OrganFile.of(file, unit), []
    if repair:
        if not silent:
            typer.echo(f"repairing {file} ...", err=True)
        organ, steps = repaired(organ)
        done.append(f"{file}: {', '.join(steps)}; written to {organ.file}" if steps else f"{file} needs no repair")
    launch, text = with_organ(launch, organ)
    done.append(text)
    if not silent:
        for line in done:
            typer.echo(line, err=True)
    return launch, done


def console(**options: Any) -> Console:
    """A rich console on standard output, made when it is needed."""
    from rich.console import Console

    return Console(highlight=False, **options)


def tell(data: Any) -> None:
    """Print JSON."""
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False, default=str))


class Verbs(TyperGroup):
    """The command group: errors are printed in red on standard error, without traceback unless `--debug` is given."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except Exception as error:
            # A palpate error says what a user needs; click's own errors, and an end that was asked for, go on.
            known = isinstance(error, PalpateError)
            own = hasattr(error, "exit_code") or isinstance(error, typer.Abort | BrokenPipeError | EOFError)
            if ctx.params.get("debug") or (own and not known):
                raise
            reported = error if isinstance(error, PalpateError) else _Foreign(error)
            if ctx.find_root().meta.get("palpate.json"):
                tell({"ok": False, **reported.to_spec()})
            else:
                _complain(str(reported), reported.hint)
            raise typer.Exit(reported.exit_code) from None


class _Foreign(PalpateError):
    """An error that palpate has not raised itself. A file that cannot be used is misuse, and needs no traceback."""

    def __init__(self, error: Exception) -> None:
        self.name = type(error).__name__
        self.of_file = isinstance(error, OSError) and bool(error.filename and error.strerror)
        text = f"{error.filename}: {error.strerror}" if self.of_file else str(error)  # type: ignore[attr-defined]
        super().__init__(text or "no details available")
        if self.of_file or isinstance(error, FileNotFoundError | FileExistsError):
            self.exit_code = MISUSE

    def __str__(self) -> str:
        return self.args[0] if self.of_file else f"{self.name}: {self.args[0]}"

    @property
    def hint(self) -> str:
        return "" if self.of_file else "`palpate --debug ...` shows the traceback."

    def to_spec(self) -> dict[str, Any]:
        return {"error": self.name, "text": self.args[0]}


def _complain(text: str, hint: str) -> None:
    from rich.text import Text

    out = console(stderr=True, soft_wrap=True)
    out.print(Text(text, style="red"))
    if hint:
        out.print(Text(hint, style="dim"))
