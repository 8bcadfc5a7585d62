"""Pages in the browser while a command runs."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import typer

from palpate.cli.terminal.output import write

if TYPE_CHECKING:
    from palpate.launch.load.launchfile import LaunchFile
    from palpate.views.page.feed import FrameSource


REMOTE = """\
warning: --host {host}: anyone who has this address with its token can see and steer the page from another machine.
The connection is not encrypted: use it only in a network that you trust."""


def show(
    source: FrameSource, verb: str, port: int, host: str, no_open: bool, over: Callable[[], bool] = lambda: False
) -> None:
    """Serve the page of a source until Ctrl-C, or until it is over. StoppedError: SIGTERM, or the terminal closed."""
    from palpate.launch.run.interrupts import StoppedError, interrupts
    from palpate.views.page import serve
    from palpate.views.page.server import LOOPBACK

    page, signals = serve(source, port, host), list[int]()
    try:
        with interrupts(signals.append):
            write(f"{verb} it at {page.address}\nCtrl-C ends it")
            if host not in LOOPBACK:
                write(REMOTE.format(host=host), err=True)
            if not no_open:
                threading.Thread(target=_open, args=(page.address,), daemon=True).start()
            while not signals and not over():
                time.sleep(0.1)
    finally:
        page.close()
    if signals and signals[0] != signal.SIGINT:
        raise StoppedError(signals[0])


class RunPage:
    """The page that shows a run. BadParameter, PalpateError: the page cannot be served.

    launch, graph  the run, changed so that its surface can be shown, and its graph
    live           the view that the launcher updates
    silent         do not print the address
    """

    def __init__(self, launch: LaunchFile, silent: bool) -> None:
        from palpate.views.page import check, serve

        check()
        from palpate.views.page.live import LiveView, watchable

        self.launch = watchable(launch)
        planned = self.launch.plan()
        self.graph = planned.graph
        if len(self.launch.placement(planned).groups) == 1 and self.launch.clock != "real":
            raise typer.BadParameter("--view: a run in one process on the simulated clock has no sockets; leave "
                                     "out --fused, or look at its recording: palpate view FILE")  # fmt: skip
        self.live = LiveView(planned)
        self._server = serve(self.live)
        if not silent:
            write(f"view it at {self._server.address}", err=True)
        _open(self._server.address)

    def stay(self) -> None:
        """Serve the page until its last viewer leaves, or Ctrl-C."""
        from palpate.launch.run.interrupts import until_ctrl_c

        with until_ctrl_c():
            write("the view stays open until you close it or press Ctrl-C", err=True)
            while not self._server.deserted:
                time.sleep(0.2)

    def close(self) -> None:
        self._server.close()


def _open(address: str) -> None:
    import webbrowser  # help does not need it

    webbrowser.open(address)
