"""Signals by which a user or the system asks a run to end: Ctrl-C, `kill`, a terminal that closes."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def interrupts(handler: Callable[[], None]) -> Iterator[None]:
    """Call `handler` for each such signal while the block runs. Outside the main thread signals are the caller's
    affair: nothing is changed there."""
    before = {}
    try:
        for number in ENDING:
            with contextlib.suppress(ValueError):
                if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
                    before[number] = signal.signal(number, lambda *_: handler())
        yield
    finally:
        for number, known in before.items():
            signal.signal(number, known)
