"""`palpate run`: one run of a graph, seen live, recorded, and drawn."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.launch.commands.common import (
    TROUBLE,
    Fused,
    Graph,
    Json,
    OrganOption,
    PlaceOption,
    RepairOption,
    SceneOption,
    Sets,
    UnitOption,
    chosen,
    console,
    seconds,
    tell,
    with_own_organ,
)

if TYPE_CHECKING:
    from rich.console import Console

    from palpate.engine.graph import Graph as Checked
    from palpate.launch.load.launchfile import LaunchFile
    from palpate.launch.run.execute import RunOutcome
    from palpate.views.page.live import LiveView
    from palpate.views.page.server import PageServer


def run(
    graph: Graph = "kidney",
    sets: Sets = None,
    scene: SceneOption = None,
    organ: OrganOption = None,
    unit: UnitOption = None,
    repair: RepairOption = False,
    place: PlaceOption = None,
    fused: Fused = False,
    clock: Annotated[str | None, typer.Option(help="simulated or real.")] = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Duration on the graph's clock: seconds, or with a unit.", parser=seconds, metavar="TIME"),
    ] = None,
    pace: Annotated[
        float | None, typer.Option(help="Pace of simulated time, as a multiple of real time.", min=1e-3, max=1e6)
    ] = None,
    record: Annotated[Path | None, typer.Option(help="File of the recording; pictures are written next to it.")] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Record nothing.")] = False,
    record_only: Annotated[
        str | None,
        typer.Option(
            help="sources: record only what cannot be recomputed; the rest is computed when the file is read."
        ),
    ] = None,
    leave_out: Annotated[list[str] | None, typer.Option("--leave-out", help="Stream not to record.")] = None,
    thin: Annotated[list[str] | None, typer.Option(help="STREAM=N: record only every N-th message.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of recording and pictures.")] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the pictures of the run at its end.")] = True,
    see: Annotated[bool, typer.Option("--view", help="Show the run in the browser while it runs.")] = False,
    timeout: Annotated[float, typer.Option(help="Time in s after which a silent node counts as hung.", min=0.1)] = 5.0,
    address: Annotated[str | None, typer.Option(help="tcp://host:port where workers of other hosts join.")] = None,
    key: Annotated[str, typer.Option(help="Key that secures connections to other hosts; see `palpate keys`.")] = "rig",
    unencrypted: Annotated[bool, typer.Option("--unencrypted", help="Do not encrypt TCP connections.")] = False,
    reconnect: Annotated[bool, typer.Option("--reconnect", help="Wait for a device that is unplugged.")] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 if a run on the real clock did not keep its rate.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No live view.")] = False,
    as_json: Json = False,
) -> None:
    """Run a graph: live view, recording, summary, pictures.

    Ctrl-C or SIGTERM ends the run cleanly. Exit code 1 if a node failed or the recording is incomplete; with
    --strict also if a run on the real clock did not keep its rate; 130 after Ctrl-C, 143 after SIGTERM.
    """
    from palpate.launch.load.launchfile import RECORDED
    from palpate.launch.run.forkserver import ForkServer

    loaded: Checked | None = None
    watch: LiveView | None = None
    seen: PageServer | None = None
    forkserver = None if fused and clock != "real" else ForkServer()  # it imports while the graph is read
    try:
        launch = chosen(graph, sets, scene, place, fused)
        launch, organ_notes = with_own_organ(launch, organ, unit, repair, silent=as_json)
        if clock not in (None, "simulated", "real"):
            raise typer.BadParameter(f"clock: found {clock!r}, expected simulated or real")
        if record_only not in (None, *RECORDED):
            raise typer.BadParameter(f"--record-only: found {record_only!r}, expected {' or '.join(RECORDED)}")
        launch = launch.but(clock=clock, duration=duration, pace=pace, only=record_only)
        if reconnect:
            launch = launch.but(overrides=_reconnecting(launch))
        name = (organ or launch.path or launch.graph).stem
        folder = out or (record.parent if record else Path("runs") / f"{name}-{datetime.datetime.now():%Y%m%d-%H%M%S}")
        keep = not no_record and (record is not None or out is not None or launch.record is not None)
        file = (record or folder / (launch.record.name if launch.record else f"{name}.mcap")) if keep else None
        launch = dataclasses.replace(launch, record=file)
        if see:
            launch = _watchable(launch)
            loaded = launch.load()
            watch, seen = _seen(launch, loaded, as_json)

        from palpate.launch.run.descendants import none_left
        from palpate.launch.run.execute import execute
        from palpate.launch.run.screen import tell as fault

        view = None if quiet or as_json else console()
        with none_left():
            outcome = execute(
                launch, loaded, console=view, forkserver=forkserver, patience=timeout, address=address,
                leave_out=leave_out or (), thin=_thin(thin or []), unencrypted=unencrypted, key_name=key,
                fit_cores=True, watch=watch.on_update if watch else lambda _: None,
            )  # fmt: skip
        if watch:
            watch.over()
    except BaseException:
        if seen is not None:
            seen.close()
        raise
    finally:
        if forkserver is not None:
            forkserver.close()
    if as_json:
        outcome.result.notes[:0] = organ_notes
    drawn = _pictures(outcome, folder, as_json or quiet) if pictures and file is not None else []
    if as_json:
        tell({**_data(outcome), "pictures": [str(p) for p in drawn]})
    else:
        if outcome.result.ticks or outcome.result.ok:
            _summary(outcome, name, drawn)
        for death in outcome.result.deaths:
            fault(death, console(stderr=True, soft_wrap=True))
    if seen is not None:
        if outcome.result.interrupted or as_json:
            seen.close()
        else:
            with contextlib.suppress(KeyboardInterrupt):
                typer.echo("the view stays until it is closed, or Ctrl-C", err=True)
                while not seen.deserted:
                    time.sleep(0.2)
            seen.close()
    late = strict and outcome.verdict is not None and not outcome.verdict.kept
    if late or not outcome.ok:
        raise typer.Exit(TROUBLE)
    if outcome.result.signal:
        raise typer.Exit(128 + outcome.result.signal)


def _watchable(launch: LaunchFile) -> LaunchFile:
    """The run with the shape of its body computed, though no node of it may read that; at the pace of the world, as
    one that is faster is over before it is seen."""
    from palpate.nodes.base.effect import effects

    can = {effect.name for spec in launch.load().nodes.values() for effect in effects(spec.cls)}
    shape = ["effects.shape=on"] if "shape" in can else []
    return launch.but(overrides=shape, pace=1.0 if launch.clock != "real" and launch.pace is None else None)


def _seen(launch: LaunchFile, loaded: Checked, silent: bool) -> tuple[LiveView, PageServer]:
    """Open the page that shows the run. BadParameter, PalpateError: nothing can be opened."""
    import webbrowser

    from palpate.launch.load.plan import plan
    from palpate.views.page import check, serve

    check()
    from palpate.views.page.live import LiveView

    planned = plan(loaded)
    if len(launch.placement(planned).groups) == 1 and launch.clock != "real":
        raise typer.BadParameter("--view: a run in one process on the simulated clock has no sockets; leave "
                                 "out --fused, or look at its recording: palpate view FILE")  # fmt: skip
    watch = LiveView(planned)
    opened = serve(watch)
    if not silent:
        typer.echo(f"view it at {opened.address}", err=True)
    webbrowser.open(opened.address)
    return watch, opened


def _reconnecting(launch: LaunchFile) -> list[str]:
    """The settings by which all nodes with a device wait for it."""
    from palpate.nodes.base import settings

    devices = [name for name, spec in launch.load().nodes.items() if "reconnect" in settings(spec.cls)]
    if not devices:
        raise typer.BadParameter("--reconnect: no node of this graph drives a device that can be reconnected")
    return [f"{name}.reconnect=true" for name in devices]


def _thin(given: list[str]) -> dict[str, int]:
    factors = {}
    for text in given:
        stream, _, number = text.partition("=")
        if not number.isdigit() or int(number) < 1:
            raise typer.BadParameter(f"--thin: found {text!r}, expected STREAM=N with N from 1")
        factors[stream] = int(number)
    return factors


def _pictures(outcome: RunOutcome, folder: Path, silent: bool) -> list[Path]:
    from palpate.records.stored import RecordingError
    from palpate.views.pictures import draw

    if outcome.recording is None or not outcome.recording.is_file() or not outcome.result.ticks:
        return []
    try:
        return draw(outcome.recording, folder, console=None if silent else console())
    except (RecordingError, OSError) as error:
        outcome.result.notes.append(f"no pictures: {error}")
    except KeyboardInterrupt:
        outcome.result.notes.append("no pictures: interrupted")
        outcome.result.signal = signal.SIGINT
    return []


def _summary(outcome: RunOutcome, name: str, drawn: list[Path]) -> None:
    from rich.markup import escape
    from rich.text import Text

    from palpate.launch.run.screen import table

    out, result = console(), outcome.result
    seconds = result.ticks / outcome.plan.graph.rate
    speed = f", {seconds / result.wall:.2f} x real time" if result.wall > 0 else ""
    out.print(
        f"[bold]{escape(name)}[/] {'interrupted after ' if result.interrupted else ''}{seconds:.3f} s, "
        f"{result.ticks} ticks in {result.wall:.2f} s{speed}; first tick {result.start:.2f} s after the start"
    )
    if result.health:
        out.print(table(result))
    if outcome.verdict is not None:
        _judge(outcome, out)
    for node, reason in outcome.plan.skipped.items():
        out.print(Text(f"skipped {node}: {reason}", style="dim"))
    for note in (*outcome.plan.graph.notes, *result.notes):
        out.print(Text(note, style="yellow"))
    if outcome.recording is not None and outcome.recording.is_file() and result.ticks:
        out.print(Text(f"recording {outcome.recording} ({outcome.recording.stat().st_size / 1e6:.1f} MB)"))
    for picture in drawn:
        out.print(Text(f"picture   {picture}"))


def _judge(outcome: RunOutcome, out: Console) -> None:
    """Whether the run kept its rate, what its counters mean, and what would help."""
    from rich.text import Text

    from palpate.launch.load.placement import AUTO
    from palpate.launch.run.verdict import TROUBLES

    verdict = outcome.verdict
    assert verdict is not None
    out.print(Text(str(verdict), style="green" if verdict.kept else "bold yellow"))
    for key, meaning in TROUBLES.items():
        if any(health[key] for health in outcome.result.health.values()):
            out.print(Text(meaning, style="dim"))
    if not verdict.kept:
        place = f"try --place {AUTO} (force path in one process); " if outcome.placed != AUTO else ""
        out.print(Text(f"{place}`palpate doctor` shows what slows this machine"))


def _data(outcome: RunOutcome) -> dict[str, Any]:
    result = outcome.result
    return {
        "ok": outcome.ok,
        "ticks": result.ticks,
        "rate": outcome.plan.graph.rate,
        "start": result.start,
        "origin": result.origin,
        "wall": result.wall,
        "interrupted": result.interrupted,
        "verdict": None
        if outcome.verdict is None
        else {**dataclasses.asdict(outcome.verdict), "kept": outcome.verdict.kept},
        "recording": str(outcome.recording) if outcome.recording else None,
        "nodes": result.health,
        "skipped": outcome.plan.skipped,
        "notes": [*outcome.plan.graph.notes, *result.notes],
        "deaths": [dataclasses.asdict(death) for death in result.deaths],
    }
