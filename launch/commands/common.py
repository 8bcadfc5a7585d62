"""What the verbs share: their options, finding what to run, printing, and errors without traceback."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from rich.console import Console

    from palpate.launch.loading.launchfile import LaunchFile

TROUBLE = 1
"""Exit code of a run that failed."""
MISUSE = 2
"""Exit code of a wrong graph, setting or command line."""
INTERRUPTED = 130
"""Exit code of a run that Ctrl-C ended."""


def _names(incomplete: str) -> list[str]:
    from palpate.launch.loading.launchfile import names

    return [name for name in names() if name.startswith(incomplete)]


def _as_json(context: typer.Context, value: bool) -> bool:
    context.find_root().meta["palpate.json"] = value
    return value


Graph = Annotated[
    str, typer.Argument(help="Launch file or graph: one that ships, or a path.", autocompletion=_names, metavar="GRAPH")
]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", help="Set one value: tissue.stiffness=2e3, scene.finger.h0='3 mm', rate=500."),
]
SceneOption = Annotated[str | None, typer.Option("--scene", help="Scene in place of the graph's own.")]
PlaceOption = Annotated[
    str | None, typer.Option("--place", help="Placement file: who shares a process, on which core.")
]
Fused = Annotated[bool, typer.Option("--fused", help="Everything in one process.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.", callback=_as_json, is_eager=True)]


def chosen(
    graph: str, sets: list[str] | None = None, scene: str | None = None, place: str | None = None, fused: bool = False
) -> LaunchFile:
    """The run that the options describe. GraphError: what is wrong with them."""
    from palpate.launch.loading.files import PLACES, SCENES, find_file
    from palpate.launch.loading.launchfile import find
    from palpate.launch.loading.placement import FUSED

    scene_file = None if scene is None else find_file(scene, SCENES, what="scene")
    if fused and place not in (None, FUSED):
        raise typer.BadParameter(f"--fused puts everything in one process, --place {place} says otherwise: take one")
    place_file: Path | str | None = None
    if fused or place == FUSED:
        place_file = FUSED
    elif place is not None:
        place_file = find_file(place, PLACES, what="placement")
    return find(graph).but(overrides=sets or (), scene=scene_file, place=place_file)


def console(**options: Any) -> Console:
    """A rich console on standard output, made when it is needed."""
    from rich.console import Console

    return Console(highlight=False, **options)


def tell(data: Any) -> None:
    """Print JSON."""
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False, default=str))


class Verbs(TyperGroup):
    """The command group: errors are told in red on standard error, without traceback unless `--debug` is given."""

    def invoke(self, ctx: Any) -> Any:
        from palpate.launch.loading.faults import GraphError

        try:
            return super().invoke(ctx)
        except GraphError as error:
            if ctx.params.get("debug"):
                raise
            if ctx.find_root().meta.get("palpate.json"):
                tell({"ok": False, "faults": [fault.to_spec() for fault in error.faults]})
            else:
                _complain(str(error), f"{len(error.faults)} fault{'s' * (len(error.faults) != 1)}.")
            raise typer.Exit(MISUSE) from None
        except Exception as error:
            own = hasattr(error, "exit_code") or isinstance(error, typer.Abort | BrokenPipeError | EOFError)
            if own or ctx.params.get("debug"):
                raise
            text = str(error) or "no more is known"
            if ctx.find_root().meta.get("palpate.json"):
                tell({"ok": False, "error": type(error).__name__, "text": text})
            elif _is_told(error):
                _complain(text, "")
            else:
                _complain(f"{type(error).__name__}: {text}", "`palpate --debug ...` shows the traceback.")
            raise typer.Exit(_code(error)) from None


def _is_told(error: Exception) -> bool:
    """Whether the text of an error says all that a user needs."""
    told = (
        ("palpate.launch.recording.reader", "RecordingError"),
        ("palpate.launch.running.watch", "NoRun"),
        ("palpate.nodes.base", "SettingError"),
    )
    return any(module in sys.modules and isinstance(error, getattr(sys.modules[module], name)) for module, name in told)


def _code(error: Exception) -> int:
    """A wrong setting or a file that is not there is misuse; the rest is trouble of the run."""
    base = sys.modules.get("palpate.nodes.base")
    misuse = (FileNotFoundError, FileExistsError) + ((base.SettingError,) if base else ())
    return MISUSE if isinstance(error, misuse) else TROUBLE


def _complain(text: str, hint: str) -> None:
    from rich.text import Text

    out = console(stderr=True, soft_wrap=True)
    out.print(Text(text, style="red"))
    if hint:
        out.print(Text(hint, style="dim"))
