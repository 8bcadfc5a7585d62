"""Which loop a worker runs: on the simulated clock, on the real one, or for observers alone."""

from __future__ import annotations

import gc

from palpate.launch.run.work.observe import observe
from palpate.launch.run.work.real import run_real
from palpate.launch.run.work.simulated import run_simulated
from palpate.launch.run.work.worker import EndedError, Worker


def run(worker: Worker, origin: int, senders: set[str] = frozenset()) -> None:  # type: ignore[assignment]
    """Run all ticks.

    origin   [ns] time of tick 0 on the machine's monotonic clock
    senders  the groups whose nodes the observers here listen to

    NodeError: a node failed.
    """
    worker.begin(origin)
    freezes = gc.get_freeze_count() == 0  # else who called has set aside what was there before
    if worker.job.clock == "real":
        gc.collect()
        gc.disable()
    if freezes:
        gc.freeze()
    try:
        if worker.slots and worker.job.clock == "real":
            _run_to_stop(worker, origin)
        elif worker.slots:
            run_simulated(worker, origin)
        if worker.audience.slots and worker.bus is not None:
            observe(worker, senders)
    except EndedError:
        pass
    finally:
        gc.enable()
        if freezes:
            gc.unfreeze()
        worker.finish()


def _run_to_stop(worker: Worker, origin: int) -> None:
    """Run on the real clock. EndedError: told to quit; told to stop, the observers here still hear the others."""
    try:
        run_real(worker, origin)
    except EndedError:
        if not worker.stopping:
            raise
