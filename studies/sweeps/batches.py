"""The points of a study as batches for a pool of workers. What is stored decides which points are left to compute."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from typing import Any

from palpate.physics.errors import RunError
from palpate.studies.sweeps.point import Computed, Point, Task
from palpate.studies.sweeps.runner import ENOUGH, work

MOST = 500  # points in a batch
AHEAD = 2  # batches per worker that the pool knows: the next one is there when one ends


@dataclass(frozen=True)
class Pool:
    """Where batches are computed: one worker has one thread and computes one batch at a time.

    executor  submits batches to them
    workers   their number
    """

    executor: Executor
    workers: int


def compute(pool: Pool, task: Task, points: Sequence[Point], add: Callable[[Point, Computed], None]) -> None:
    """Compute points in a pool. `add` is called with each computed point.

    RunError: a worker computes with other versions, or a disk is full.
    """
    waiting = deque(points)
    flight: dict[Future[Any], list[Point]] = {}
    seconds = ENOUGH
    try:
        while waiting or flight:
            while waiting and len(flight) < AHEAD * pool.workers:
                share = math.ceil(len(waiting) / (AHEAD * pool.workers))
                size = max(1, min(int(ENOUGH / seconds), share, MOST))
                batch = [waiting.popleft() for _ in range(size)]
                flight[pool.executor.submit(work, task, batch)] = batch
            for future in wait(flight, timeout=1.0, return_when=FIRST_COMPLETED).done:
                batch = flight.pop(future)
                done = future.result()
                waiting.extendleft(reversed(batch[len(done) :]))
                for point, one in zip(batch, done, strict=False):
                    if one.lost:
                        raise RunError(f"{one.lost}; what was computed before is stored")
                    seconds += 0.2 * (max(one.seconds, 1e-3) - seconds)
                    add(point, one)
    finally:
        for future in flight:
            future.cancel()
