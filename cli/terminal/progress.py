"""Commands that take minutes: what they do and how long it takes, on a terminal or in a log; on a busy machine, that
their times are too long."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from palpate.cli.terminal.output import console

if TYPE_CHECKING:
    from rich.console import Console

OFTEN = 10.0  # [s] between lines in a log
STEP = 0.1  # [1] share of a stage for which a line is written where there is no terminal


class Done(Protocol):
    """One step is done; `weight` is its share of the work, 1 for each where they take as long."""

    def __call__(self, what: str, weight: float = 1.0) -> None: ...


@contextmanager
def steps(
    title: str, total: float, *, silent: bool = False, seconds: float | None = None, timed: bool = True
) -> Iterator[Done]:
    """Tell on standard error what goes on: a bar on a terminal, else a line every `OFTEN` seconds.

    title    what is computed, and how much of it
    total    sum of the weights of all steps
    seconds  it will take, where that is known beforehand
    timed    whether it measures times, which a busy machine makes too long
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
    """A bar on standard error for what tells its tick and the last one."""
    from rich.progress import Progress

    with Progress(console=console(stderr=True), transient=True, disable=silent) as progress:
        task = progress.add_task(title, total=None)
        yield lambda tick, last: progress.update(task, completed=tick, total=last)


def _lines(print_: Callable[..., object], total: float) -> Done:
    told = time.monotonic()
    reached = first = begun = 0.0

    def done(what: str, weight: float = 1.0) -> None:
        nonlocal told, reached, first, begun
        moment, reached = time.monotonic(), reached + weight
        left = ""
        if not first:  # compiling is part of the first step: it does not say how long the others take
            first, begun = weight, moment
        else:
            left = f", about {duration((moment - begun) * (total - reached) / (reached - first))} left"
        if reached < total and moment - told >= OFTEN:
            told = moment
            print_(f"{100 * reached / total:3.0f} %{left}: {what}")

    return done


def duration(seconds: float) -> str:
    """A length of time in words: 40 s, 6 min."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"


class Stages:
    """Used as a context: `begin` a stage, report the share of it that is done by the function that this returns."""

    def __init__(self, out: Console, quiet: bool = False) -> None:
        from rich.progress import Progress, TextColumn, TimeRemainingColumn

        self.lines = not (quiet or out.is_terminal)
        self.out = out
        columns = (*Progress.get_default_columns()[:3], TextColumn("{task.fields[note]}"), TimeRemainingColumn())
        self.bars = Progress(*columns, console=out, disable=quiet or self.lines)

    def __enter__(self) -> Stages:
        self.bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bars.stop()

    def begin(self, name: str, note: str, total: float | None = 1.0) -> Callable[..., None]:
        """A stage; `total` None where it cannot say how far it is. What it returns takes the share, and a new note."""
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
