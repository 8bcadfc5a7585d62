"""Signals that end a run: SIGINT (Ctrl-C), SIGTERM, SIGHUP (the terminal closes)."""

import contextlib
import os
import signal
import stat
from collections.abc import Callable, Iterator, Sequence

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
STOPPING = "stopping; Ctrl-C again ends the run at once\n"


class StoppedError(KeyboardInterrupt):
    """SIGTERM or a closed terminal; `number` of the signal. Raised even where Ctrl-C is ignored, as in the background
    of a script; by its type `NodeError` distinguishes it from a KeyboardInterrupt that a node raised."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def signal_of(error: KeyboardInterrupt) -> int:
    """The number of the signal that caused an exception."""
    return error.number if isinstance(error, StoppedError) else int(signal.SIGINT)


@contextlib.contextmanager
def until_ctrl_c() -> Iterator[None]:
    """Ctrl-C ends the block normally. SIGTERM and a closed terminal still raise StoppedError."""
    try:
        yield
    except KeyboardInterrupt as error:
        if isinstance(error, StoppedError):
            raise


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
