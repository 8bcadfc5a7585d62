"""The live view of a run in the terminal, and the table that stays when it has ended."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from palpate.launch.running.result import Death, Result

FULL_SCALE = 3.0  # [N] of the force bars, until a force goes beyond


class Screen:
    """Draws a run while it goes on: rates, step times, late, lost and held messages of each node, and force bars.

    title  what runs
    rate   [Hz] base rate
    ticks  of the run, None: until stopped
    order  in which the nodes are listed
    """

    def __init__(self, console: Console, title: str, rate: float, ticks: int | None, order: Sequence[str]) -> None:
        self.console, self.title, self.rate, self.ticks, self.order = console, title, rate, ticks, order
        self._live = Live(console=console, refresh_per_second=8, transient=True)
        self._begun = time.monotonic()
        self._before: dict[str, tuple[int, float]] = {}
        self._speed: dict[str, float] = {}
        self._scale = FULL_SCALE
        self._drawn = 0.0

    def __enter__(self) -> Screen:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, result: Result, phase: str = "running", busy: dict[str, str] | None = None) -> None:
        """Draw what is known; at most eight times a second."""
        moment = time.monotonic()
        if moment - self._drawn < 0.12:
            return
        self._drawn = moment
        self._count(result, moment)
        result.health = {name: result.health[name] for name in self.order if name in result.health}
        self._live.update(self._draw(result, phase, busy or {}, moment))

    def print(self, text: str) -> None:
        """Lines that the nodes print, above the view."""
        if text.strip():
            self.console.print(Text(text.rstrip("\n"), style="dim"))

    def died(self, death: Death) -> None:
        """A node that failed, with its traceback, above the view."""
        tell(death, self.console)

    def _count(self, result: Result, moment: float) -> None:
        for name, health in result.health.items():
            steps, then = self._before.get(name, (0, self._begun))
            if health["steps"] != steps and moment > then:
                self._speed[name] = (health["steps"] - steps) / (moment - then)
                self._before[name] = (health["steps"], moment)

    def _draw(self, result: Result, phase: str, busy: dict[str, str], moment: float) -> RenderableType:
        tick = max((h["tick"] for h in result.health.values()), default=0)
        head = Text.assemble((self.title, "bold"), f"  {phase}  ", (f"{tick / self.rate:8.3f} s", "cyan"))
        parts: list[RenderableType] = [head]
        if phase in ("starting", "linking"):
            waiting = ", ".join(sorted(busy.values())) or "workers"
            parts.append(Text(f"  {phase}: {waiting} ({moment - self._begun:.1f} s)", style="dim"))
        if self.ticks:
            bar = Table.grid()  # a bar by itself does not end its line
            bar.add_row(ProgressBar(total=self.ticks, completed=tick + 1, width=60))
            parts.append(bar)
        parts += [table(result, self._speed), self._forces(result)]
        return Group(*parts)

    def _forces(self, result: Result) -> RenderableType:
        grid = Table.grid(padding=(0, 1))
        for health in result.health.values():
            for name, value in health.get("forces", {}).items():
                self._scale = max(self._scale, value)
                grid.add_row(name, ProgressBar(total=self._scale, completed=value, width=40), f"{value:6.3f} N")
        return grid


def tell(death: Death, console: Console) -> None:
    """Print a death and its traceback."""
    console.print(Text(str(death), style="red"))
    # These say by themselves what to change.
    if death.trace and not death.text.startswith(("SettingError", "DeviceError", "InputFault")):
        console.print(Text(death.trace.rstrip(), style="dim"))


def table(result: Result, speed: dict[str, float] | None = None) -> Table:
    """One row per node; `speed` [Hz] while it runs, else the mean over the run."""
    grid = Table(box=None, header_style="bold", pad_edge=False)
    grid.add_column("node")
    for title in ("steps", "rate [Hz]", "p50 [us]", "p99 [us]", "longest [us]", "late", "lost", "held", "asleep"):
        grid.add_column(Text(title), justify="right")  # as text: brackets are no markup here
    for name, health in result.health.items():
        rate = speed.get(name, 0.0) if speed is not None else health["steps"] / result.wall if result.wall else 0.0
        step = health["step"]
        troubles = [
            Text(str(health[key]), style="yellow" if health[key] else "dim") for key in ("late", "lost", "held")
        ]
        times = [f"{step[key] * 1e6:.1f}" for key in ("p50", "p99", "longest")]
        asleep = Text(str(health["asleep"]), style="" if health["asleep"] else "dim")
        grid.add_row(name, str(health["steps"]), f"{rate:.0f}", *times, *troubles, asleep)
    return grid
