"""Runs the loop of a worker: on the simulated clock, on the real one, or only for observers."""

import gc

from palpate.engine.clock import Silence
from palpate.launch.run.reports import Observes
from palpate.launch.run.work.real import run_real
from palpate.launch.run.work.simulated import run_simulated
from palpate.launch.run.work.worker import EndedError, Worker


def run(worker: Worker, origin: int, senders: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    """Run all ticks.

    origin   [ns] time of tick 0 on the machine's monotonic clock
    senders  the groups that the observers here read

    NodeError: a node failed.
    """
    worker.begin(origin)
    collects = gc.isenabled()
    freezes = worker.bus is None and not gc.get_freeze_count()  # otherwise the fork server or the user has done so
    if worker.job.clock == "real":
        gc.collect()
        gc.disable()
    if freezes:
        gc.freeze()
    try:
        if worker.slots:
            real = worker.job.clock == "real"
            try:
                (run_real if real else run_simulated)(worker)
            except EndedError:  # after the last tick the observers continue, unless `Quit` was ordered
                if not (worker.stopping if real else worker.last is not None and worker.tick > worker.last):
                    raise
        if worker.audience.slots and worker.bus is not None:
            if worker.slots:
                worker.end_streams()
                worker.report(Observes())
            observe(worker, senders)
    except EndedError:
        pass
    finally:
        if collects:
            gc.enable()
        if freezes:
            gc.unfreeze()
        worker.finish()


QUIET = 500_000_000  # [ns] without a frame after which killed senders have no more frames in transit


def observe(worker: Worker, senders: set[str]) -> None:
    """Pass messages to the observers until all streams have ended: the last message of each has arrived, or all senders
    have sent their end-of-stream marker. Killed senders send none: then the end is `QUIET` without a frame.

    senders  the groups that the observers read
    """
    audience, silence = worker.audience, Silence()
    waited_for = worker.slots and worker.job.clock == "real"
    while not audience.has_all(worker.last):
        if worker.overhear(wait=True):
            silence.reset()
        else:
            if worker.stopping or audience.ended >= senders:
                left = senders - audience.ended
                if left <= audience.lost and (not left or silence.poll() > QUIET):
                    return
            if waited_for:
                worker.offer_end()
        worker.drain()
        worker.check_orders()
        worker.housekeep()
