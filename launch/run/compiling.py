"""The first run on a machine compiles the kernels, and later ones load them: what takes a minute is told."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def compiling(report: Callable[[int], None]) -> Iterator[None]:
    """Call `report` whenever a kernel is about to be compiled, with how many there were so far. Not for what the cache
    holds, and not in a process that has not imported numba yet."""
    if "numba" not in sys.modules:
        yield
        return
    from numba.core import event

    class Compiled(event.Listener):  # type: ignore[misc]
        count = 0

        def on_start(self, event: Any) -> None:
            self.count += 1
            report(self.count)

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Compiled()):
        yield
