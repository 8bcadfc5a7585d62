"""`palpate fit record`: one press on real tissue, as a session for `palpate fit force`."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Duration, Json, Sets
from palpate.cli.terminal.output import console, print_json, write
from palpate.physics.errors import TROUBLE

EXAMPLE = "palpate fit record press.csv --subject gel --session 1 --set sensor.port=emulator --set device.port=emulator"
FOLDS = 9  # sessions that `palpate fit force` compares force models with, unless it is given fewer folds


def record(
    sessions: Annotated[Path, typer.Argument(help="CSV file to which the session is added.")],
    subject: Annotated[str, typer.Option(help="Who or what is pressed.")],
    session: Annotated[str, typer.Option(help="Name of this press; use a new one for each press.")],
    graph: Annotated[str, typer.Option(help="Graph with a pose `finger` and a force `sensor`.")] = "indentation",
    sets: Sets = None,
    duration: Duration = None,
    depth: Annotated[float, typer.Option(help="Largest depth in the table, in mm.", min=0.1, max=100)] = 5.0,
    step: Annotated[float, typer.Option(help="Spacing of the depths, in mm.", min=0.01, max=10)] = 0.5,
    touch: Annotated[float, typer.Option(help="Force at which contact begins, in N.", min=1e-4, max=10)] = 0.05,
    as_json: Json = False,
) -> None:
    """Record one press with a device and a force sensor.

    Push slowly against the tissue, along the sensor's normal, deeper than --depth, for 10 s or --duration. Force and
    speed of the loading phase, at evenly spaced depths, are added as a session to a CSV that `palpate fit force` reads.
    A press at changing speed determines the damping as well. A recording of the whole press is written next to it.
    """
    from palpate.launch.load.launchfile import find
    from palpate.launch.run.execute import execute
    from palpate.launch.run.screen import print_death
    from palpate.messages import Contact, Pose
    from palpate.models.fit.press import add_session, press_of, rows_before
    from palpate.models.fit.sessions import SessionError
    from palpate.records.reader import Recording

    # Check the options, then run the graph on the real clock and record it.
    duration = duration or 10.0
    if not 0.5 <= duration <= 3600.0:
        raise typer.BadParameter(f"--duration: found {duration:g} s, expected 0.5 s to 1 h")
    rows_before(sessions, subject, session)  # fails before the press, and before a recording is overwritten
    file = sessions.with_name(f"{sessions.stem}-{subject}-{session}.mcap")
    launch = find(graph).but(overrides=sets or (), duration=duration, record=file, clock="real")
    outcome = execute(launch, console=None if as_json else console())
    outcome.raise_signal()
    if not outcome.result.ok:
        for death in outcome.result.deaths:
            print_death(death, console(stderr=True, soft_wrap=True))
        raise typer.Exit(TROUBLE)
    # Extract force and speed over depth from the recording, and add them as a session.
    recording = Recording(file)
    poses, contacts = (recording.stream_of(kind) for kind in (Pose, Contact))
    if poses is None or contacts is None:
        raise SessionError(
            f"{file}: expected one stream of Pose and one of Contact; it has {', '.join(recording.streams)}"
        )
    pressed = [message for message in recording.messages(poses) if isinstance(message, Pose)]
    felt = [message for message in recording.messages(contacts) if isinstance(message, Contact)]
    press = press_of(pressed, felt, 1e-3 * depth, 1e-3 * step, touch, file)
    count = add_session(sessions, subject, session, press)
    if as_json:
        data = {"ok": True, "file": str(sessions), "recording": str(file), "sessions": count}
        arrays = {"depths": press.depth, "rates": press.rate, "forces": press.force}
        print_json(data | {name: values.tolist() for name, values in arrays.items()})
        return
    write(
        f"{len(press.depth)} depths to {1e3 * press.depth[-1]:g} mm, at up to {1e3 * press.rate.max():.3g} mm/s and "
        f"{press.force.max():.3g} N: added to {sessions}"
    )
    write(f"recording {file}")
    law = "--rig ball --radius '8 mm' --law power --relaxation hunt-crossley"
    write(f"next: palpate fit tissue {file} {law}  # the shape of your probe")
    more = f"{FOLDS - count} more sessions for" if count < FOLDS else "or"
    write(f"      {more} the scatter of the force: palpate fit force {sessions}")
