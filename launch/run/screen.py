"""The live view of a run in the terminal, and the table of a finished run."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from palpate.launch.run.result import NodeFault, Result

FULL_SCALE = 3.0  # [N] initial full scale of the force bars

KERNELS = 150  # number of kernels that the kidney graph compiles, roughly
COMPILING = "compiling the kernels for this processor: once, 15 s to a minute; later runs start at once"


class Screen:
    """Draws a running graph: rates, step times, late ticks, lost messages and held inputs of each node, and force bars.

    title  name of the run
    rate   [Hz] base rate
    ticks  number of ticks; None: until stopped
    order  order of the nodes in the table
    """

    def __init__(self, console: Console, title: str, rate: float, ticks: int | None, order: Sequence[str]) -> None:
        self.console, self.title, self.rate, self.ticks, self.order = console, title, rate, ticks, order
        self._live = Live(console=console, refresh_per_second=8, transient=True)
        self._begun = time.monotonic()
        self._before: dict[str, tuple[int, float]] = {}
        self._speed: dict[str, float] = {}
        self._scale = FULL_SCALE
        self._drawn = 0.0
        self._kernels = 0

    def __enter__(self) -> Screen:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(
        self, result: Result, phase: str = "running", busy: dict[str, str] | None = None, kernels: int = 0
    ) -> None:
        """Redraw, at most eight times a second. kernels: number compiled so far."""
        moment = time.monotonic()
        if kernels and not self._kernels:
            self.console.print(Text(COMPILING))
        self._kernels = max(self._kernels, kernels)
        if moment - self._drawn < 0.12:
            return
        self._drawn = moment
        for name, health in result.health.items():
            steps, then = self._before.get(name, (0, self._begun))
            if health["steps"] != steps and moment > then:
                self._speed[name] = (health["steps"] - steps) / (moment - then)
                self._before[name] = (health["steps"], moment)
        result.health = {name: result.health[name] for name in self.order if name in result.health}
        self._live.update(self._draw_state(result, phase, busy or {}, moment))

    def print(self, text: str) -> None:
        """Print output of the nodes above the view."""
        if text.strip():
            self.console.print(Text(text.rstrip("\n"), style="dim"))

    def _draw_state(self, result: Result, phase: str, busy: dict[str, str], moment: float) -> RenderableType:
        tick = max((h["tick"] for h in result.health.values()), default=0)
        head = Text.assemble((self.title, "bold"), f"  {phase}  ", (f"{tick / self.rate:8.3f} s", "cyan"))
        parts: list[RenderableType] = [head]
        if phase in ("starting", "linking"):
            waiting = ", ".join(sorted(busy.values())) or "workers"
            parts.append(Text(f"  {phase}: {waiting} ({moment - self._begun:.1f} s)", style="dim"))
            if self._kernels:
                compiled = Table.grid(padding=(0, 1))
                done = ProgressBar(total=max(KERNELS, self._kernels), completed=self._kernels, width=40)
                compiled.add_row("  compiling", done, f"{self._kernels} of about {KERNELS} kernels")
                parts.append(compiled)
        if self.ticks:
            bar = Table.grid()  # a bar without a grid does not end its line
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


def print_death(death: NodeFault, console: Console) -> None:
    """Print a failure with its traceback."""
    console.print(Text(str(death), style="red"))
    # The text of these errors says what to change.
    if death.trace and not death.text.startswith(("SettingError", "DeviceError", "InputError")):
        console.print(Text(death.trace.rstrip(), style="dim"))


def table(result: Result, speed: dict[str, float] | None = None) -> Fitted:
    """One row per node; `speed`: current rates [Hz], default the mean of the run."""
    timed = (f"{name}\n[us]" for name in ("p50", "p99", "longest"))
    titles = ("node", "steps", "rate\n[Hz]", *timed, "late", "lost", "held", "asleep")
    rows = []
    for name, health in result.health.items():
        rate = speed.get(name, 0.0) if speed is not None else health["steps"] / result.wall if result.wall else 0.0
        times = [Text(f"{health['step'][key] * 1e6:.1f}") for key in ("p50", "p99", "longest")]
        counts = troubles(health["late"], health["lost"], health["held"])
        asleep = Text(str(health["asleep"]), style="" if health["asleep"] else "dim")
        rows.append([Text(name), Text(str(health["steps"])), Text(f"{rate:.0f}"), *times, *counts, asleep])
    return Fitted(titles, rows, spare=("steps", "asleep", "longest\n[us]", "p50\n[us]", "held"))


def troubles(*counts: int) -> list[Text]:
    """Counts, highlighted if not 0."""
    return [Text(str(count), style="yellow" if count else "dim") for count in counts]


class Fitted:
    """A table that drops columns in a narrow terminal, so that no number is cut.

    titles  of the columns; the first one, and a last one without a title, are left-aligned
    rows    cells
    spare   titles of the columns to drop, in this order
    """

    def __init__(self, titles: Sequence[str], rows: Sequence[Sequence[Text]], spare: Sequence[str]) -> None:
        self.titles, self.rows, self.spare = list(titles), rows, spare

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        gone: list[str] = []
        grid, endless = self._grid(gone), options.update(max_width=1000)
        while len(gone) < len(self.spare) and console.measure(grid, options=endless).maximum > options.max_width:
            gone.append(self.spare[len(gone)])
            grid = self._grid(gone)
        yield grid
        if gone:
            names = ", ".join(title.split("\n")[0] for title in gone)
            yield Text(f"a wider terminal also shows: {names}", style="dim")

    def _grid(self, gone: Sequence[str]) -> Table:
        kept = [k for k, title in enumerate(self.titles) if title not in gone]
        grid = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 0, 0, 1))
        for k in kept:
            # As Text, so that brackets are not markup.
            grid.add_column(Text(self.titles[k]), justify="right" if k and self.titles[k] else "left", no_wrap=True)
        for row in self.rows:
            grid.add_row(*(row[k] for k in kept))
        return grid
