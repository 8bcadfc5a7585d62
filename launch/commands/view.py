"""`palpate view`: recordings in the browser, at any instant."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import Trust

if TYPE_CHECKING:
    from palpate.views.page.source import FrameSource


def view(
    files: Annotated[list[Path], typer.Argument(help="A recording, or two to compare side by side.")],
    port: Annotated[int, typer.Option(help="Port of the page on 127.0.0.1; 0: any free port.", min=0, max=65535)] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open the browser.")] = False,
    trust: Trust = None,
) -> None:
    """View a recording in the browser: any instant, playback, slow motion, single steps; two side by side.

    Ctrl-C ends it.
    """
    from palpate.views.page import check

    check()
    from palpate.views.page.reel import Reels

    reels = Reels(files)
    for reel in reels.reels:
        if reel.recording.ending:
            typer.echo(reel.recording.ending, err=True)
    show(reels, "see", port, no_open)


def show(source: FrameSource, verb: str, port: int, no_open: bool) -> None:
    """Serve the page of a source until Ctrl-C."""
    import webbrowser

    from palpate.launch.run.interrupts import interrupts
    from palpate.views.page import serve

    page, signals = serve(source, port), list[int]()
    try:
        with interrupts(signals.append):
            typer.echo(f"{verb} it at {page.address}\nCtrl-C ends it")
            if not no_open:
                threading.Thread(target=webbrowser.open, args=(page.address,), daemon=True).start()
            while not signals:
                time.sleep(0.1)
    finally:
        page.close()
