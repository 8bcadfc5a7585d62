"""The points of a study as batches for a pool of workers. What is stored decides which points are left to compute."""

import contextlib
import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from typing import Any

from palpate.physics.errors import PalpateError, RunError
from palpate.studies.sweeps.point import Computed, Point, Task
from palpate.studies.sweeps.runner import ENOUGH, work

MOST = 500  # points in a batch
AHEAD = 2  # batches per worker that the pool knows: the next one is there when one ends
DEATHS = 2  # of a worker under one point alone, after which the point is to blame


@dataclass(frozen=True)
class Pool:
    """Where batches are computed: one worker has one thread and computes one batch at a time.

    executor  submits batches to them;  workers  their number at this moment
    killed    exceptions of a batch whose worker died under it
    """

    executor: Executor
    workers: Callable[[], int]
    killed: tuple[type[Exception], ...] = ()


def compute(
    pool: Pool,
    task: Task,
    points: Sequence[Point],
    add: Callable[[Point, Computed, str], None],
    waits: Callable[[], None],
) -> None:
    """Compute points in a pool. `add` is called with each computed point and the name of its machine, `waits` about
    once a second while the pool has no worker.

    RunError: a worker computes with other versions, or a disk is full.
    """
    waiting, deaths = deque(points), Counter[str]()
    flight: dict[Future[Any], list[Point]] = {}
    seconds = ENOUGH
    try:
        while waiting or flight:
            workers = pool.workers()
            if not workers:
                waits()
            while waiting and len(flight) < AHEAD * max(1, workers):
                share = math.ceil(len(waiting) / (AHEAD * max(1, workers)))
                size = 1 if deaths[waiting[0].key] else max(1, min(int(ENOUGH / seconds), share, MOST))
                batch = [waiting.popleft() for _ in range(size)]
                flight[pool.executor.submit(work, task, batch)] = batch
            for future in wait(flight, timeout=1.0, return_when=FIRST_COMPLETED).done:
                batch = flight.pop(future)
                machine, done = _result(future, pool.killed, batch, deaths)
                waiting.extendleft(reversed(batch[len(done) :]))
                for point, one in zip(batch, done, strict=False):
                    if one.lost:
                        raise RunError(f"{machine}: {one.lost}; what was computed before is stored")
                    seconds += 0.2 * (max(one.seconds, 1e-3) - seconds)
                    add(point, one, machine)
    finally:
        with contextlib.suppress(Exception):  # a lost scheduler has nothing to cancel
            for future in flight:
                future.cancel()


def _result(
    future: Future[Any], killed: tuple[type[Exception], ...], batch: list[Point], deaths: Counter[str]
) -> tuple[str, list[Computed]]:
    """What a batch has given. A worker that dies under it, again and again, is the fault of its only point."""
    try:
        return future.result()
    except killed as error:
        deaths.update(point.key for point in batch)
        if len(batch) == 1 and deaths[batch[0].key] >= DEATHS:
            return str(getattr(error, "last_worker", "")), [Computed(error="the worker died under it, again and again")]
        return "", []
    except (PalpateError, CancelledError, OSError):
        raise
    except Exception as error:
        raise RunError(
            f"a worker cannot compute: {type(error).__name__}: {error}; is palpate installed there?"
        ) from error
