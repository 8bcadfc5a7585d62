"""The stages of a long computation: bars on a terminal, lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeRemainingColumn

STEP = 0.1
"""[1] Share of a stage for which a line is written where there is no terminal."""


class Stages:
    """Used as a context: `begin` a stage, report the share of it that is done by the function that this returns."""

    def __init__(self, out: Console, quiet: bool = False) -> None:
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
