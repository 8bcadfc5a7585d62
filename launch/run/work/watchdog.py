"""Ends a node that hangs where no launcher watches: in a run that is one process."""

import contextlib
import faulthandler
import signal
import time
from collections.abc import Iterator
from types import FrameType

from palpate.engine.slot import ObserverSlot, Slot
from palpate.launch.run.work.worker import Worker

LAST = 60.0  # [s] at least until the process ends, a time that cannot be told from that of a machine that stands still
START_PATIENCE = 120.0  # [s] for a node's `start`: it may compile kernels or build a basis
GLANCES = 8  # looks in the time that a node is given


class HangError(Exception):
    """A node has been in one call for too long."""


@contextlib.contextmanager
def watched(patience: float | None, last: float | None = None) -> Iterator[None]:
    """A node's call that takes longer than `patience` [s] while the block runs gets `HangError` raised inside it.
    None: nothing is watched.

    A timer's signal looks at the call that runs, so that the loop itself pays nothing. Each look counts a quarter of
    the patience at most, so that a machine that stands still is no hang. Compiled code that never returns, or a call of
    the system that waits for a disk, lets no handler run: then the process ends after `last` [s], where it is left out
    `LAST` or twice the patience if that is longer, after telling on standard error where it was. Outside the main
    thread nothing is watched, nor where the system has no such timer.
    """
    before: object = None
    spent, looked = 0.0, time.monotonic()
    end = max(2.0 * (patience or 0.0), LAST) if last is None else last

    def check(_: int, frame: FrameType | None) -> None:
        nonlocal before, spent, looked
        with contextlib.suppress(OSError, ValueError):  # a standard error that is no file
            faulthandler.dump_traceback_later(end, exit=True)
        moment, here = time.monotonic(), _running(frame)
        spent += min(moment - looked, 2.0 * (patience or 0.0) / GLANCES)
        looked = moment
        if here is None or here != before:
            before, spent = here, 0.0
        elif patience is not None and spent >= patience:
            raise HangError(f"no sign of life for {patience:.3g} s")

    known = None
    if patience is not None and hasattr(signal, "setitimer"):  # else not POSIX: nothing is watched
        with contextlib.suppress(ValueError):
            known = signal.signal(signal.SIGALRM, check)
    if known is None or patience is None:
        yield
        return
    left, _ = signal.setitimer(signal.ITIMER_REAL, patience / GLANCES, patience / GLANCES)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, known)
        signal.setitimer(signal.ITIMER_REAL, left)


def _running(frame: FrameType | None) -> object:
    """Which node's call is under way, and which call of it; None between two."""
    while frame is not None:
        if frame.f_code in (Slot.step.__code__, ObserverSlot.take.__code__):
            slot = frame.f_locals["self"]
            return id(slot), slot.health.step.count
        if frame.f_code in (Worker.start.__code__, Worker.stop.__code__):
            return frame.f_code, frame.f_locals["self"].started
        frame = frame.f_back
    return None
