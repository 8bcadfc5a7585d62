"""Progress of work that takes minutes: bars on a terminal, otherwise lines in a log."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from palpate.launch.run.busy import busy
from palpate.launch.run.wire.printable import printable

INTERVAL = 10.0  # [s] between lines in a log
SOON = 1.0  # [s] after which the preparation of a surface is reported


class StageBars:
    """Progress of stages on standard error, as a context: bars on a terminal, otherwise lines every `INTERVAL`."""

    def __init__(self, silent: bool = False) -> None:
        from rich import progress as rich
        from rich.console import Console

        self.out = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
        self.lines = not (silent or self.out.is_terminal)
        self.bars = rich.Progress(
            rich.TextColumn("{task.description}"), rich.BarColumn(), rich.TaskProgressColumn(),
            rich.TimeElapsedColumn(), rich.TextColumn("{task.fields[left]}"), rich.TimeRemainingColumn(),
            rich.TextColumn("{task.fields[note]}"),
            console=self.out, transient=True, disable=silent or self.lines,
        )  # fmt: skip

    def __enter__(self) -> StageBars:
        self.bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bars.stop()

    def begin(self, name: str, note: str = "", total: float | None = 1.0) -> Callable[..., None]:
        """Begin a stage; `total` None: duration unknown. The function returned takes the fraction done and a note.

        In a log, the name of the stage is printed with its first progress report, so that invalid input prints only its
        error.
        """
        name, note = printable(name), printable(note)
        task = self.bars.add_task(name, total=total, note=note, left="" if total is None else "left")
        printed, named = time.monotonic(), not (self.lines and name and note)
        first = begun = 0.0
        text = f"{name}: {note} ..."
        if total is None and not named:
            named = True
            self.out.print(text)

        def done(share: float, note: str = note) -> None:
            nonlocal printed, named, first, begun
            note = printable(note)
            self.bars.update(task, total=1.0, completed=share, note=note, left="left")
            if not named:
                named = True
                self.out.print(text)
            moment = time.monotonic()
            left = ""
            if not first:  # the first step includes compilation, so the estimate of the time left excludes it
                first, begun = share, moment
            elif share > first:
                left = f", about {duration((moment - begun) * (1.0 - share) / (share - first))} left"
            if self.lines and share < 1.0 and moment - printed >= INTERVAL:
                printed = moment
                self.out.print(f"{name}{': ' * bool(name)}{100 * share:3.0f} %{left}: {note}")

        return done


@contextmanager
def steps(
    title: str, total: float, *, silent: bool = False, seconds: float | None = None, timed: bool = True
) -> Iterator[Callable[..., None]]:
    """Report the progress of steps; takes the step that is done and its share of the work.

    title    what is computed, and how much of it
    total    sum of the weights of all steps; 0: unknown
    seconds  expected duration, if known
    timed    whether the command measures times: then print a warning on a busy machine
    """
    with StageBars(silent) as stages:
        if not silent:
            stages.out.print(title + ("" if seconds is None else f", roughly {duration(seconds)}"))
            if timed and (why := busy()):
                stages.out.print(f"{why}. Times that are measured now are too long.", style="yellow")
        show, reached = stages.begin(""), 0.0

        def done(what: str, weight: float = 1.0) -> None:
            nonlocal reached
            reached += weight
            show(reached / total if total else 0.0, what)

        yield done


@contextmanager
def preparing(silent: bool = False) -> Iterator[None]:
    """Within this context, report each surface of a file whose preparation takes longer than `SOON`: a bar of unknown
    duration on a terminal, otherwise a line."""
    from palpate.nodes.base.stored import watched  # help starts without the nodes

    @contextmanager
    def watch(what: str) -> Iterator[None]:
        bars = StageBars(silent)

        def begin() -> None:
            bars.__enter__()
            bars.begin("Preparing", what, total=None)

        timer = threading.Timer(SOON, begin)
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
            timer.join()
            bars.__exit__()

    with watched(watch):
        yield


@contextmanager
def ticks(title: str, *, silent: bool = False) -> Iterator[Callable[[int, int], None]]:
    """Report the progress of a replay; takes the tick and the last tick."""
    with StageBars(silent) as stages:
        done = stages.begin(title)
        yield lambda tick, last: done(tick / max(last, 1))


def duration(seconds: float) -> str:
    """A duration as text: 40 s, 6 min."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
