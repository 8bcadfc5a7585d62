"""`palpate record-indentation`: one press on real tissue, as a session for `palpate fit`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import TROUBLE, Json, Sets, console, tell

if TYPE_CHECKING:
    import numpy as np


def record_indentation(
    sessions: Annotated[Path, typer.Argument(help="CSV that the session is added to.")],
    subject: Annotated[str, typer.Option(help="Who or what is pressed.")],
    session: Annotated[str, typer.Option(help="Name of this press; another one for each.")],
    graph: Annotated[str, typer.Option(help="Graph with a pose `finger` and a force `sensor`.")] = "indentation",
    sets: Sets = None,
    duration: Annotated[float, typer.Option(help="[s] to press in.", min=0.5, max=3600)] = 10.0,
    depth: Annotated[float, typer.Option(help="[mm] to which the forces are taken.", min=0.1, max=100)] = 5.0,
    step: Annotated[float, typer.Option(help="[mm] between two of them.", min=0.01, max=10)] = 0.5,
    touch: Annotated[float, typer.Option(help="[N] from which on it touches.", min=1e-4, max=10)] = 0.05,
    as_json: Json = False,
) -> None:
    """Record one press: push slowly against the tissue, along the sensor's normal, deeper than --depth.

    The forces of the way in, at even depths, become a session of a CSV that `palpate fit` reads. The whole press lies
    beside it as a recording.
    """
    from palpate.launch.commands.press import add_session, press_of
    from palpate.launch.loading.launchfile import find
    from palpate.launch.running.execute import execute
    from palpate.launch.running.screen import tell as fault

    file = sessions.with_name(f"{sessions.stem}-{subject}-{session}.mcap")
    launch = find(graph).but(overrides=sets or (), duration=duration, record=file, clock="real")
    outcome = execute(launch, console=None if as_json else console())
    if not outcome.result.ok:
        for death in outcome.result.deaths:
            fault(death, console(stderr=True, soft_wrap=True))
        raise typer.Exit(TROUBLE)
    depths, forces = press_of(file, 1e-3 * depth, 1e-3 * step, touch)
    add_session(sessions, subject, session, depths, forces)
    _say(sessions, file, depths, forces, as_json)


def _say(sessions: Path, file: Path, depths: np.ndarray, forces: np.ndarray, as_json: bool) -> None:
    if as_json:
        tell({"ok": True, "file": str(sessions), "recording": str(file), "depths": depths.tolist(),
              "forces": forces.tolist()})  # fmt: skip
    else:
        typer.echo(f"{len(depths)} depths to {1e3 * depths[-1]:g} mm, {forces[-1]:.3g} N: added to {sessions}")
        typer.echo(f"recording {file}; next: palpate fit {sessions}")
