"""`palpate view`: recordings in the browser, at any time of theirs."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import Trust
from palpate.records.reader import RecordingError

if TYPE_CHECKING:
    from palpate.views.page.reel import Reel

MOST = 2
"""Recordings beside one another."""


def view(
    files: Annotated[list[Path], typer.Argument(help="A recording, or two to see them side by side.")],
    port: Annotated[int, typer.Option(help="Of the page on 127.0.0.1; 0: any.", min=0, max=65535)] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open the browser.")] = False,
    trust: Trust = None,
) -> None:
    """Look at a recording in the browser: the organ at any time, play, slow motion, step by step; two side by side.

    Ctrl-C ends it.
    """
    look(files, port, no_open)


def look(files: list[Path], port: int = 0, no_open: bool = False) -> None:
    """Serve the page until Ctrl-C."""
    from palpate.views.page import needs

    needs.check()
    from palpate.views.page.reel import Reel

    if len(files) > MOST:
        raise RecordingError(f"{len(files)} recordings: expected one, or two to see them side by side")
    reels = [Reel(file) for file in files]
    for reel in reels:
        if reel.recording.ending:
            typer.echo(reel.recording.ending, err=True)
    asyncio.run(_serve(reels, port, no_open))


async def _serve(reels: list[Reel], port: int, no_open: bool) -> None:
    import webbrowser

    from palpate.views.page.viewer import Viewer

    page, ended, loop = Viewer(reels), asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, ended.set)
    await page.start(port)
    typer.echo(f"see it at {page.address}\nCtrl-C ends it")
    try:
        if not no_open:
            await asyncio.to_thread(webbrowser.open, page.address)
        await ended.wait()
    finally:
        await page.close()
        for reel in reels:
            reel.close()
