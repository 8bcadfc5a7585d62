"""`palpate run`: run a graph with a live view, a recording and pictures."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.output import console
from palpate.cli.terminal.run_options import RunOptions, takes_run
from palpate.physics.errors import TROUBLE

if TYPE_CHECKING:  # slow to import
    from palpate.engine.graph import Graph
    from palpate.launch.load.launchfile import LaunchFile

EXAMPLE = "palpate run kidney --set tissue.use=deformation.ReducedFE"


@takes_run("kidney")
def run(
    chosen: RunOptions,
    place: options.PlaceOption = None,
    fused: options.Fused = False,
    clock: Annotated[str | None, typer.Option(help="simulated or real.")] = None,
    duration: options.Duration = None,
    pace: Annotated[
        float | None, typer.Option(help="Pace of simulated time, as a multiple of real time.", min=1e-3, max=1e6)
    ] = None,
    record: Annotated[Path | None, typer.Option(help="File of the recording; pictures are written next to it.")] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Record nothing.")] = False,
    record_only: Annotated[
        str | None,
        typer.Option(
            help="sources: only messages that cannot be recomputed; a reader recomputes the others; all: every message."
        ),
    ] = None,
    leave_out: Annotated[list[str] | None, typer.Option("--leave-out", help="Stream not to record.")] = None,
    thin: Annotated[list[str] | None, typer.Option(help="STREAM=N: record only every N-th message.")] = None,
    out: Annotated[Path | None, options.out_option("Folder of recording and pictures.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is not a recording.")] = False,
    no_pictures: options.NoPictures = False,
    see: Annotated[bool, typer.Option("--view", help="Show the run in the browser while it runs.")] = False,
    timeout: Annotated[float, typer.Option(help="Time in s after which a silent node counts as hung.", min=0.1)] = 5.0,
    address: Annotated[str | None, typer.Option(help="tcp://host:port where workers of other hosts join.")] = None,
    key: Annotated[
        str, typer.Option(help="Key that secures connections to other hosts; see `palpate remote keys`.")
    ] = "rig",
    unencrypted: Annotated[bool, typer.Option("--unencrypted", help="Do not encrypt TCP connections.")] = False,
    reconnect: Annotated[bool, typer.Option("--reconnect", help="Wait for a device that is unplugged.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit code 1 if the real clock was not kept.")] = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Run a graph: live view, recording, summary, pictures.

    Ctrl-C or SIGTERM ends the run cleanly. Exit code 1 if a node failed or the recording is incomplete; with
    --strict also if a run on the real clock did not keep its rate; 130 after Ctrl-C, 143 after SIGTERM, 129 after
    the terminal has closed.
    """
    from palpate.launch.load.organ_file import OrganFile

    with contextlib.ExitStack() as ending:
        # The run that the options describe.
        launch = chosen.launch(place, fused, silent=as_json)
        options.one_of("clock", clock, "simulated", "real")
        launch = launch.but(clock=clock, duration=duration, pace=pace)
        launch = options.reconnecting(launch) if reconnect else launch
        name = OrganFile(chosen.organ).stem if chosen.organ else (launch.path or launch.graph).stem
        launch, folder = options.recorded_to(launch, name, record, out, no_record, record_only, ending)
        loaded = page = None
        if see:
            from palpate.cli.terminal.browser import RunPage

            page = RunPage(launch, as_json)
            launch, loaded = page.launch, page.graph
            ending.callback(page.close)

        from palpate.bases import build_missing
        from palpate.cli.terminal.run_summary import print_end
        from palpate.launch.run.execute import Network, execute
        from palpate.launch.run.work.spawner import worker_server
        from palpate.records.times import step_times

        # Build the bases that it lacks, run it, then print the summary and draw the pictures.
        loaded = _prepared(launch, loaded, as_json)
        build_missing(loaded, quiet=as_json)
        forkserver = None
        if not fused or clock == "real":
            forkserver = worker_server(forked=True)
            ending.callback(forkserver.close)
        outcome = execute(
            launch, loaded, console=None if quiet or as_json else console(), forkserver=forkserver,
            patience=timeout, network=Network(address, unencrypted, key), leave_out=leave_out or (),
            thin=options.thin_factors(thin or []), step_times=lambda planned: step_times(planned, None)[0],
            watch=page.live.on_update if page else lambda _: None, fit_cores=True, force=force,
        )  # fmt: skip
        if not as_json:
            outcome.result.live.update(launch.notes)
        if page is not None:
            page.live.over()
        print_end(outcome, name, None if no_pictures else folder, as_json, quiet)
        if page is not None and not (outcome.result.interrupted or as_json):
            page.stay()
    if not outcome.ok or (strict and outcome.verdict is not None and not outcome.verdict.kept):
        raise typer.Exit(TROUBLE)
    if outcome.result.signal:
        raise typer.Exit(128 + outcome.result.signal)


def _prepared(launch: "LaunchFile", loaded: "Graph | None", silent: bool) -> "Graph":
    """The graph of a run, whose surfaces are prepared, with the progress of this."""
    from palpate.launch.run.progress import preparing
    from palpate.launch.run.work.shared import share_surfaces

    with preparing(silent):
        loaded = loaded or launch.load()
        share_surfaces(loaded)
    return loaded
