"""Watchdog for nodes that hang in a run without a launcher, in one process."""

import contextlib
import faulthandler
import signal
import time
from collections.abc import Iterator
from threading import current_thread, main_thread
from types import FrameType

from palpate.engine.slot import ObserverSlot, Slot
from palpate.launch.run.work.activity import waited_for_processor
from palpate.launch.run.work.compiling import LONGEST, compiler_watched
from palpate.launch.run.work.worker import Worker

LAST = 60.0  # [s] lower bound of the time until the process is killed, since a stalled machine looks like a hang
START_PATIENCE = 120.0  # [s] for a node's `start`: it may build a basis
CHECKS = 8  # checks within the patience


class HangError(Exception):
    """A node has been in one call for too long."""


@contextlib.contextmanager
def watch_call(patience: float | None, last: float | None = None) -> Iterator[None]:
    """Raise `HangError` inside a node's call that takes longer than `patience` [s] while the block runs. None: no
    watchdog.

    A timer signal checks the running call, so that the loop has no overhead. Each check counts at most a quarter of the
    patience, so that a stalled machine does not count as a hang, and no time in which this thread waited for a
    processor. During a `start` processor time has the limit `LONGEST`: it may compute for long. Compiled code that
    never returns, or a system call that waits for a disk, blocks the handler: then the process prints a traceback and
    exits after `last` [s] (default: `LAST` or twice the patience, whichever is longer). While the compiler works on a
    function, both limits are at least `LONGEST`. No effect outside the main thread and without timer signals.
    """
    if patience is None or not hasattr(signal, "setitimer") or current_thread() is not main_thread():
        yield
        return
    before: object = None
    spent, checked, waited, used = 0.0, time.monotonic(), waited_for_processor(), time.process_time()
    computed = 0.0
    end = max(2.0 * patience, LAST) if last is None else last

    working = False

    def kill_later() -> None:
        with contextlib.suppress(OSError, ValueError):  # standard error is not a file
            faulthandler.dump_traceback_later(max(end, 2.0 * LONGEST) if working else end, exit=True)

    def compiler_changed(active: bool) -> None:
        nonlocal working, spent, computed, checked
        working, spent, computed, checked = active, 0.0, 0.0, time.monotonic()
        kill_later()

    def check(_: int, frame: FrameType | None) -> None:
        nonlocal before, spent, computed, checked, waited, used
        kill_later()
        moment, here = time.monotonic(), _running(frame)
        passed = min(moment - checked, 2.0 * patience / CHECKS)
        delay, work = waited_for_processor() - waited, time.process_time() - used
        checked, waited, used = moment, waited + delay, used + work
        work = min(work, passed)
        computed += work
        spent += max(0.0, passed - delay - work)
        starts = isinstance(here, tuple) and here[0] is Worker.start.__code__
        limit = max(patience, LONGEST) if working else patience
        longest = max(patience, LONGEST) if working or starts else patience
        if here is None or here != before:
            before, spent, computed = here, 0.0, 0.0
        elif spent >= limit or spent + computed >= longest:
            raise HangError(f"no sign of life for {limit if spent >= limit else longest:g} s")

    known = signal.signal(signal.SIGALRM, check)
    left, _ = signal.setitimer(signal.ITIMER_REAL, patience / CHECKS, patience / CHECKS)
    try:
        with compiler_watched(compiler_changed):
            yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, known)
        signal.setitimer(signal.ITIMER_REAL, left)


def running_node(frame: FrameType | None) -> str:
    """Name of the node or observer whose call is running in a frame; "": none."""
    while frame is not None:
        slot = _slot_of(frame)
        if slot is not None:
            return slot.name
        frame = frame.f_back
    return ""


def _slot_of(frame: FrameType) -> Slot | ObserverSlot | None:
    return frame.f_locals["self"] if frame.f_code in (Slot.step.__code__, ObserverSlot.take.__code__) else None


def _running(frame: FrameType | None) -> object:
    """The running node, the number of its call and, in an observer, the message; None between two calls."""
    while frame is not None:
        slot = _slot_of(frame)
        if slot is not None:
            # An observer handles many messages in one call: a process without processor time may need seconds.
            return id(slot), slot.health.step.count, frame.f_locals.get("stream"), frame.f_locals.get("tick")
        if frame.f_code in (Worker.start.__code__, Worker.stop.__code__):
            return frame.f_code, frame.f_locals["self"].started
        frame = frame.f_back
    return None
