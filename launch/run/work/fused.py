"""Runs a whole graph in this process, without sockets; for debuggers, tests, sweeps and speed."""

import contextlib
import faulthandler
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

import palpate.engine
import palpate.messages
import palpate.nodes
from palpate.engine.clock import now
from palpate.engine.job import Job
from palpate.engine.slot import NodeError
from palpate.launch.run.interrupts import STOPPING, interrupts
from palpate.launch.run.notes import RunNote
from palpate.launch.run.reports import Alive, Note, Report, Starting
from palpate.launch.run.result import NodeFault, Result
from palpate.launch.run.work.loops import run
from palpate.launch.run.work.watchdog import START_PATIENCE, watch_call
from palpate.launch.run.work.worker import Worker
from palpate.physics.errors import PalpateError

RAISED_AGAIN = 0.5  # [s] after which an interrupt during the start is raised again


def run_fused(
    job: Job,
    show: Callable[[Result], None] = lambda _: None,
    patience: float | None = None,
    starting: Callable[[str, int], None] = lambda node, kernels: None,
    printed: Callable[[str], None] = lambda _: None,
) -> Result:
    """Run a job that contains all nodes and observers of a graph.

    show      called about five times a second with the result so far
    starting  called with the node that is started, and the number of kernels compiled so far
    patience  [s] longest call of a node before it counts as hung; None: no limit, for a debugger
    printed   called with a line when the start is interrupted

    The failure of a node ends the run and is in the result. Ctrl-C or SIGTERM ends the run after the tick, a second
    one immediately.
    """
    here = _Here(show, starting, printed)
    with crash_traceback(), interrupts(here.handle_signal):
        try:
            here.run(job, patience)
        except (NodeError, KeyboardInterrupt) as error:
            here.end(error)
    if here.worker is not None:
        here.result.ticks = here.worker.tick + 1
    return here.result


class _Here:
    """A run in this process: its worker, its result so far, and what its reports and signals do."""

    def __init__(
        self, show: Callable[[Result], None], starting: Callable[[str, int], None], printed: Callable[[str], None]
    ) -> None:
        self._show, self._starting, self._printed = show, starting, printed
        self.result = Result()
        self.worker: Worker | None = None

    def run(self, job: Job, patience: float | None) -> None:
        """Start the nodes, run all ticks and stop the nodes; each phase has its timeout."""
        begun = time.monotonic()
        self.worker = Worker(job, None, self._report)
        with watch_call(None if patience is None else START_PATIENCE):
            self.worker.start()
        started = time.monotonic()
        self.result.start = started - begun
        self.result.origin = started
        try:
            with watch_call(patience):
                run(self.worker, now())
        finally:
            self.result.wall = time.monotonic() - started
            with watch_call(patience, START_PATIENCE):  # writing a long recording to a slow disk takes time
                self.worker.stop()

    def end(self, error: NodeError | KeyboardInterrupt) -> None:
        """Note a failure or an interrupt, and stop the nodes."""
        if self.result.interrupted and hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        _note(self.result, error)
        if self.worker is not None:
            try:
                self.worker.stop()
            except NodeError as second:
                _note(self.result, second)

    def handle_signal(self, number: int) -> None:
        again, self.result.signal = self.result.interrupted, self.result.signal or number
        if not self.result.start:
            if not again:
                self._printed(STOPPING)
            # Code that compiles may catch the exception: it is raised again until the start has ended.
            if hasattr(signal, "setitimer"):
                signal.signal(signal.SIGALRM, lambda *_: self.handle_signal(number))
                signal.setitimer(signal.ITIMER_REAL, RAISED_AGAIN)
        if again or not self.result.start:
            raise KeyboardInterrupt
        assert self.worker is not None
        self.worker.stopping = True

    def _report(self, what: Report) -> None:
        if isinstance(what, Alive):
            self.result.health.update(msgspec.to_builtins(what.nodes))
            self._show(self.result)
        elif isinstance(what, Starting):
            self._starting(what.node, what.kernels)
        elif isinstance(what, Note):
            self.result.notes.append(RunNote(what.text, what.node, what.time))


OURS = (
    str(Path(__file__).parents[1]),
    *(str(Path(m.__file__ or "").parent) for m in (palpate.engine, palpate.messages)),
)
NODES = str(Path(palpate.nodes.__file__ or "").parent)


def _note(result: Result, error: NodeError | KeyboardInterrupt) -> None:
    """Add a failure to the result, except a second Ctrl-C, which raises in the node that is running."""
    if isinstance(error, NodeError) and not (result.interrupted and isinstance(error.cause, KeyboardInterrupt)):
        result.deaths.append(death(error))


def death(fault: NodeError) -> NodeFault:
    cause = fault.cause
    if isinstance(cause, MemoryError):  # not necessarily the fault of the node that ran
        during = f"while node {fault.node!r} had its turn ({fault.where})"
        return NodeFault("", "process", f"there was no memory left {during}: {cause or 'MemoryError'}")
    if isinstance(cause, BaseException):
        return NodeFault(fault.node, fault.where, f"{type(cause).__name__}: {cause}".removesuffix(": "), _trace(cause))
    return NodeFault(fault.node, fault.where, cause)


def _trace(cause: BaseException) -> str:
    """The traceback without the frames of the engine above the node's code. Empty if the node's code raised nothing (it
    sent a NaN), and for errors of the system or of palpate in shipped nodes, whose message suffices."""
    inner = cause.__traceback__
    while inner is not None and inner.tb_frame.f_code.co_filename.startswith(OURS):
        inner = inner.tb_next
    expected = isinstance(cause, OSError | PalpateError)
    if inner is None or (expected and inner.tb_frame.f_code.co_filename.startswith(NODES)):
        return ""
    return "".join(traceback.format_exception(type(cause), cause, inner))


@contextlib.contextmanager
def crash_traceback() -> Iterator[None]:
    """Print a traceback if compiled code crashes while the block runs."""
    if sys.__stderr__ is None or faulthandler.is_enabled():
        yield
        return
    faulthandler.enable(file=sys.__stderr__, all_threads=False)
    try:
        yield
    finally:
        faulthandler.disable()
