"""The first run on a machine compiles the kernels, and later ones load them: what takes a minute is told."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def compiling(report: Callable[[int], None]) -> Iterator[None]:
    """Call `report` whenever a kernel is about to be compiled, with how many there were so far. Not for what the cache
    holds, and not in a process that has not imported numba yet. Meanwhile no garbage is collected: the compiler makes
    millions of objects and keeps them, and looking through them takes 6 % of its time."""
    if "numba" not in sys.modules:
        yield
        return
    from numba.core import event

    class Compiled(event.Listener):  # type: ignore[misc]
        count = depth = 0

        def on_start(self, event: Any) -> None:
            self.count += 1
            self.depth += 1
            gc.disable()
            report(self.count)

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if not self.depth:  # a kernel compiles those that it calls
                gc.enable()

    with event.install_listener("numba:compile", Compiled()):
        try:
            yield
        finally:
            gc.enable()  # an interrupt may have come before the end of a kernel
