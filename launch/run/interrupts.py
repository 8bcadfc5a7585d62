"""Signals that end a run: SIGINT (Ctrl-C), SIGTERM, SIGHUP (the terminal closes)."""

import contextlib
import os
import signal
import stat
from collections.abc import Callable, Iterator, Sequence

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
STOPPING = "stopping; Ctrl-C again ends the run at once\n"


@contextlib.contextmanager
def interrupts(handler: Callable[[int], None], numbers: Sequence[int] = ENDING) -> Iterator[None]:
    """Call `handler` with the number of each of these signals while the block runs; only in the main thread."""
    before = {}
    try:
        for number in numbers:
            with contextlib.suppress(ValueError):
                if signal.getsignal(number) is not signal.SIG_IGN:  # ignored under nohup
                    before[number] = signal.signal(number, lambda number, _: _call(handler, number))
        yield
    finally:
        for number, known in before.items():
            signal.signal(number, known)


def _call(handler: Callable[[int], None], number: int) -> None:
    if number == getattr(signal, "SIGHUP", None):
        _leave_terminal()
    handler(number)


def _leave_terminal() -> None:
    """Redirect output to /dev/null if the terminal has closed: printing would raise errors during the shutdown."""
    for output in (1, 2):
        with contextlib.suppress(OSError):
            if stat.S_ISCHR(os.fstat(output).st_mode) and not os.isatty(output):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, output)
                os.close(nowhere)
