"""`palpate touch`: a page in the browser where the mouse is the finger."""

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.browser import show
from palpate.cli.terminal.output import write
from palpate.cli.terminal.run_options import RunOptions, takes_run
from palpate.physics.errors import TROUBLE

EXAMPLE = "palpate touch kidney"


@takes_run("kidney")
def touch(
    chosen: RunOptions,
    port: options.Port = 0,
    host: options.Host = "127.0.0.1",
    no_open: options.NoOpen = False,
    no_record: Annotated[
        bool, typer.Option("--no-record", help="Keep no recordings unless the page requests it.")
    ] = False,
    record_only: Annotated[
        str, typer.Option(help="sources: only messages that cannot be recomputed; all: every message.")
    ] = "sources",
    out: Annotated[Path | None, options.out_option("Folder of the recordings.")] = None,
) -> None:
    """Touch a graph with the mouse, on a page in the browser.

    A simulated hand replaces the device and follows the pointer of the page. The graph runs on the real clock in
    separate processes. Ctrl-C ends it. Exit code 1 if a node failed or a recording is incomplete.
    """
    from palpate.views.page import check

    check()
    options.one_of("--record-only", record_only, "all", "sources")
    from palpate.bases import build_missing
    from palpate.launch.load.recording import new_folder
    from palpate.launch.run.interrupts import StoppedError
    from palpate.studies.body_figures import measure_bodies
    from palpate.views.page.session import Session

    sets = chosen.sets or []
    launch = (replace(chosen, sets=None) if chosen.organ is None else chosen).launch()
    build_missing(launch.but(overrides=sets).load())
    with contextlib.nullcontext(out) if out else new_folder("touch") as folder:
        session = Session(
            launch, folder, list(sets), record_only, lambda graph, begin: build_missing(graph, begin=begin),
            measure_bodies,
        )  # fmt: skip
        session.keep = not no_record
        stopped: StoppedError | None = None
        try:
            show(session, "touch", port, host, no_open)
        except StoppedError as error:  # the recordings are complete
            stopped = error
    for file in session.kept:
        write(f"recording {file} ({file.stat().st_size / 1e6:.1f} MB)")
    for trouble in session.troubles:
        write(trouble, err=True)
    if stopped is not None:
        raise stopped
    if session.troubles:
        raise typer.Exit(TROUBLE)
