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
    session: Annotated[str, typer.Option(help="Name of this press; use a new one for each press.")],
    graph: Annotated[str, typer.Option(help="Graph with a pose `finger` and a force `sensor`.")] = "indentation",
    sets: Sets = None,
    duration: Annotated[float, typer.Option(help="Duration of the press, in s.", min=0.5, max=3600)] = 10.0,
    depth: Annotated[float, typer.Option(help="Largest depth of the forces, in mm.", min=0.1, max=100)] = 5.0,
    step: Annotated[float, typer.Option(help="Spacing of the depths, in mm.", min=0.01, max=10)] = 0.5,
    touch: Annotated[float, typer.Option(help="Force at which contact begins, in N.", min=1e-4, max=10)] = 0.05,
    as_json: Json = False,
) -> None:
    """Record one press: push slowly against the tissue, along the sensor's normal, deeper than --depth.

    The forces of the loading phase, at evenly spaced depths, are added as a session to a CSV that `palpate fit` reads.
    A recording of the whole press is written beside it.
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
