"""`palpate touch`: a page in the browser where the mouse is the finger."""

from __future__ import annotations

import asyncio
import datetime
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import (
    Graph,
    OrganOption,
    RepairOption,
    SceneOption,
    Sets,
    UnitOption,
    chosen,
    with_own_organ,
)

if TYPE_CHECKING:
    from palpate.views.page.session import Session


def touch(
    graph: Graph = "kidney",
    sets: Sets = None,
    scene: SceneOption = None,
    organ: OrganOption = None,
    unit: UnitOption = None,
    repair: RepairOption = False,
    port: Annotated[int, typer.Option(help="Of the page on 127.0.0.1; 0: any.", min=0, max=65535)] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open the browser.")] = False,
    no_record: Annotated[bool, typer.Option("--no-record", help="Keep no recordings unless the page asks.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder of the recordings.")] = None,
) -> None:
    """Touch a graph with the mouse: its device gives way to a hand that follows the pointer of a page in the browser.

    The graph runs on the real clock in processes of its own. Ctrl-C ends it.
    """
    from palpate.views.page import needs

    needs.check()
    from palpate.views.page.session import Session

    folder = out or Path("runs") / f"touch-{datetime.datetime.now():%Y%m%d-%H%M%S}"
    launch, _ = with_own_organ(chosen(graph, None if organ is None else sets, scene), organ, unit, repair)
    session = Session(launch, folder, list(sets or []))
    session.keep = not no_record
    asyncio.run(_serve(session, port, no_open))
    for file in session.kept:
        typer.echo(f"recording {file} ({file.stat().st_size / 1e6:.1f} MB)")


async def _serve(session: Session, port: int, no_open: bool) -> None:
    import webbrowser

    from palpate.views.page.server import Page

    page = Page(session)
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, ended.set)
    await page.start(port)
    try:
        session.start()
        typer.echo(f"touch it at {page.address}\nCtrl-C ends it")
        if not no_open:
            await asyncio.to_thread(webbrowser.open, page.address)
        await ended.wait()
    finally:
        await page.close()
        await asyncio.to_thread(session.close)
