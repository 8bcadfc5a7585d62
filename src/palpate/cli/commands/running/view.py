"""`palpate view`: recordings in the browser, at any instant."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.browser import show
from palpate.cli.terminal.options import Host, NoOpen, Port, Trust
from palpate.cli.terminal.output import write

EXAMPLE = "palpate view runs/kidney.mcap"


def view(
    files: Annotated[list[Path], typer.Argument(help="A recording, or two to compare side by side.")],
    port: Port = 0,
    host: Host = "127.0.0.1",
    no_open: NoOpen = False,
    trust: Trust = None,
) -> None:
    """View a recording in the browser, or two side by side.

    The page shows any instant, and plays the recording, also in slow motion or in single steps. Ctrl-C ends it.
    """
    from palpate.views.page import check

    check()
    from palpate.views.page.reel import Reels

    reels = Reels(files)
    for reel in reels.reels:
        for text in filter(None, (reel.recording.ending, reel.touched.bodies.left_out)):
            write(text, err=True)
    show(reels, "see", port, host, no_open)
