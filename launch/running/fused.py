"""A whole graph in one process, this one: plain calls, no sockets; for debuggers, tests, sweeps and speed."""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Callable

from palpate.launch.running.clock import now
from palpate.launch.running.job import Job
from palpate.launch.running.result import Death, Result
from palpate.launch.running.slot import NodeFault
from palpate.launch.running.worker import Worker


def run_fused(job: Job, show: Callable[[Result], None] = lambda _: None) -> Result:
    """Run a job whose nodes and observers are all in it.

    show  called about five times a second with what is known so far

    A node's fault ends the run and is in the result; Ctrl-C ends it at the end of the tick.
    """
    result = Result()
    begun = time.monotonic()

    def report(what: dict) -> None:
        if what["kind"] == "health":
            result.health.update(what["nodes"])
            show(result)
        elif what["kind"] == "note":
            result.notes.append(what["text"])

    worker = None
    before = None
    try:
        worker = Worker(job, None, report)
        worker.start()

        def interrupted(*_: object) -> None:
            result.interrupted = True
            assert worker is not None
            worker.stopping = True

        before = _on_interrupt(interrupted)
        started = time.monotonic()
        result.start = started - begun
        result.origin = started
        try:
            worker.run(now())
        finally:
            result.wall = time.monotonic() - started
            worker.stop()
    except NodeFault as fault:
        result.deaths.append(death(fault))
        if worker is not None:
            try:
                worker.stop()
            except NodeFault as second:
                result.deaths.append(death(second))
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)
    result.ticks = worker.tick + 1 if worker is not None else 0
    return result


def _on_interrupt(handler):
    try:
        return signal.signal(signal.SIGINT, handler)
    except ValueError:  # not in the main thread: the caller's affair
        return None


def death(fault: NodeFault) -> Death:
    """A fault as the result tells it."""
    cause = fault.cause
    if isinstance(cause, BaseException):
        trace = "".join(traceback.format_exception(cause))
        return Death(fault.node, fault.where, f"{type(cause).__name__}: {cause}", trace)
    return Death(fault.node, fault.where, cause)
