"""Progress of commands that take minutes, on a terminal or in a log."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from palpate.cli.terminal.output import console

if TYPE_CHECKING:
    from rich.console import Console

INTERVAL = 10.0  # [s] between lines in a log
STEP = 0.1  # [1] fraction of a stage between lines in a log


class Done(Protocol):
    """Report that a step is done; `weight` is its share of the work."""

    def __call__(self, what: str, weight: float = 1.0) -> None: ...


@contextmanager
def steps(
    title: str, total: float, *, silent: bool = False, seconds: float | None = None, timed: bool = True
) -> Iterator[Done]:
    """Report progress on standard error: a bar on a terminal, otherwise a line every `INTERVAL` seconds.

    title    what is computed, and how much of it
    total    sum of the weights of all steps
    seconds  expected duration, if known
    timed    whether the command measures times: then print a warning on a busy machine
    """
    if silent:
        yield lambda what, weight=1.0: None
        return
    from rich import progress as bars

    from palpate.launch.run.busy import busy

    out = console(stderr=True, soft_wrap=True)
    out.print(title + ("" if seconds is None else f", roughly {duration(seconds)}"))
    if timed and (why := busy()):
        out.print(f"{why}. Times that are measured now are too long.", style="yellow")
    if not out.is_terminal:
        yield _lines(out.print, total)
        return
    times = bars.TimeElapsedColumn(), bars.TextColumn("left"), bars.TimeRemainingColumn()
    columns = bars.BarColumn(), bars.TaskProgressColumn(), *times, bars.TextColumn("{task.description}")
    with bars.Progress(*columns, console=out, transient=True) as progress:
        task = progress.add_task("", total=total)
        yield lambda what, weight=1.0: progress.update(task, advance=weight, description=what)


@contextmanager
def ticks(title: str, *, silent: bool = False) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error; takes the tick and the last tick."""
    from rich.progress import Progress

    with Progress(console=console(stderr=True), transient=True, disable=silent) as progress:
        task = progress.add_task(title, total=None)
        yield lambda tick, last: progress.update(task, completed=tick, total=last)


def _lines(print_: Callable[..., object], total: float) -> Done:
    printed = time.monotonic()
    reached = first = begun = 0.0

    def done(what: str, weight: float = 1.0) -> None:
        nonlocal printed, reached, first, begun
        moment, reached = time.monotonic(), reached + weight
        left = ""
        if not first:  # the first step includes compilation, so the estimate of the time left excludes it
            first, begun = weight, moment
        else:
            left = f", about {duration((moment - begun) * (total - reached) / (reached - first))} left"
        if reached < total and moment - printed >= INTERVAL:
            printed = moment
            print_(f"{100 * reached / total:3.0f} %{left}: {what}")

    return done


def duration(seconds: float) -> str:
    """A duration as text: 40 s, 6 min."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"


class StageBars:
    """Progress bars of stages, as a context. `begin` returns the function that reports the fraction done."""

    def __init__(self, out: Console, quiet: bool = False) -> None:
        from rich.progress import Progress, TextColumn, TimeRemainingColumn

        self.lines = not (quiet or out.is_terminal)
        self.out = out
        columns = (*Progress.get_default_columns()[:3], TextColumn("{task.fields[note]}"), TimeRemainingColumn())
        self.bars = Progress(*columns, console=out, disable=quiet or self.lines)

    def __enter__(self) -> StageBars:
        self.bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bars.stop()

    def begin(self, name: str, note: str, total: float | None = 1.0) -> Callable[..., None]:
        """Begin a stage; `total` None: duration unknown. The function returned takes the fraction done and a note."""
        task = self.bars.add_task(name, total=total, note=note)
        begun, reported = time.monotonic(), 0.0
        if self.lines:
            self.out.print(f"{name}: {note} ...", soft_wrap=True)

        def done(share: float, note: str = note) -> None:
            nonlocal reported
            self.bars.update(task, total=1.0, completed=share, note=note)
            if self.lines and (share >= reported + STEP - 1e-9 or reported < 1.0 <= share):
                reported = share
                passed = time.monotonic() - begun
                left = f", about {passed * (1.0 - share) / share:.0f} s left" if share < 1.0 else ""
                self.out.print(f"{name}: {share:.0%} in {passed:.0f} s{left}")

        return done
