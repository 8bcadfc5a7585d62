"""`palpate top`: the health of the nodes of a running graph."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.terminal.output import console

if TYPE_CHECKING:
    from palpate.messages import Health

EXAMPLE = "palpate top --once"
LONGEST_GAP = 0.25  # [s] limit of the counted time between two reports: a node sends five per second


def top(
    run: Annotated[str | None, typer.Option(help="Name of the run, if there are several.")] = None,
    once: Annotated[bool, typer.Option("--once", help="Collect for one second, print, and exit.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Collect for one second, print JSON, and exit.")] = False,
) -> None:
    """Show the health of the nodes of a running graph.

    Prints rate, step times, late ticks, lost messages and held inputs of each node. Ctrl-C ends it.
    """
    from rich.live import Live

    from palpate.launch.run.interrupts import StoppedError
    from palpate.launch.run.wire.bus import HEALTH
    from palpate.launch.run.wire.discover import find, receive_messages
    from palpate.messages import Health, unpack
    from palpate.physics.errors import RunError

    live_run = find(run)
    rows: dict[str, Row] = {}
    left = 1.0 if once or as_json else None
    latest = time.monotonic()
    view = Live(console=console(), refresh_per_second=4, transient=left is not None)
    try:
        with view if left is None else contextlib.nullcontext():
            for _, payload in receive_messages(live_run, [HEALTH]):
                message, moment = unpack(payload, Health), time.monotonic()
                rows.setdefault(message.source, Row()).take(message, moment)
                if left is None:
                    view.update(_table(live_run.name, rows))
                    continue
                left, latest = left - min(moment - latest, LONGEST_GAP), moment
                if left < 0.0:
                    break
    except KeyboardInterrupt as error:
        if isinstance(error, StoppedError):
            raise
        raise typer.Exit from None
    if not rows:
        raise RunError(f"run {live_run.name} has ended")
    if as_json:
        from palpate.cli.terminal.output import print_json

        print_json({"run": live_run.name, "nodes": {name: row.data() for name, row in rows.items()}})
    elif left is not None:
        console().print(_table(live_run.name, rows))


class Row:
    """One node: its last report, and its rate between reports."""

    def __init__(self) -> None:
        self.last: Health | None = None
        self.then = self.rate = 0.0

    def take(self, message: Health, moment: float) -> None:
        """Add a report. The rate [Hz] is measured over at least 0.5 s, since reports arrive in bursts."""
        if self.last is None or message.steps < self.last.steps:
            self.steps, self.then = message.steps, moment
        elif moment - self.then > 0.5:
            self.rate = (message.steps - self.steps) / (moment - self.then)
            self.steps, self.then = message.steps, moment
        self.last = message

    def data(self) -> dict[str, Any]:
        """Plain data, SI units."""
        assert self.last is not None
        names = ("tick", "steps", "late", "lost", "held", "asleep", "median", "p99", "longest", "age", "state")
        return {"rate": self.rate, **{name: getattr(self.last, name) for name in names}}


def _table(run: str, rows: dict[str, Row]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from palpate.launch.run.screen import Fitted, troubles

    titles = ("node", "tick", "rate\n[Hz]", "p50\n[us]", "p99\n[us]", "longest\n[us]", "answer\n[us]",
              "late", "lost", "held", "asleep", "")  # fmt: skip
    cells = []
    for name, row in rows.items():
        last = row.last
        assert last is not None
        durations = [Text(f"{value * 1e6:.1f}") for value in (last.median, last.p99, last.longest, last.age)]
        counts = troubles(last.late, last.lost, last.held)
        figures = [Text(str(last.tick)), Text(f"{row.rate:.0f}"), *durations, *counts, Text(str(last.asleep))]
        cells.append([Text(name), *figures, Text("" if last.state == "ready" else last.state, style="red")])
    spare = ("asleep", "longest\n[us]", "p50\n[us]", "held", "answer\n[us]", "tick")
    return Group(Text(f"run {run}", style="italic"), Fitted(titles, cells, spare))
