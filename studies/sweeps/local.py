"""Workers of this machine: threads of this process, each with a process below it that computes its points.

They talk through unnamed pipes. Nothing listens on a port or has a name in the file system, so no other user of the
machine and nobody on the network can send work to them.
"""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from multiprocessing import Pipe
from pathlib import Path

from palpate.physics.errors import RunError
from palpate.studies.sweeps.point import Computed, Point, Task
from palpate.studies.sweeps.runner import Runner, start_with, work

AHEAD = 2  # points per worker that the pool knows: the next one is there when one ends


@dataclass(frozen=True)
class Pool:
    """Threads, and their number; each computes one point at a time."""

    executor: ThreadPoolExecutor
    workers: int


def cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0))


@contextlib.contextmanager
def local(workers: int, log: Path) -> Iterator[Pool]:
    """A pool that ends with everything it has started; what its processes print goes to a file."""
    ended, end = Pipe(duplex=False)
    runners: list[Runner] = []
    with (
        tempfile.TemporaryDirectory(prefix="palpate-study-", ignore_cleanup_errors=True) as scratch,
        open(log, "wb") as printed,
        ended,
        end,
    ):

        def start() -> Runner:
            # Killed processes leave their files in `scratch`, which is removed with the pool.
            runners.append(Runner({"TMPDIR": scratch}, printed, ended))
            return runners[-1]

        executor = ThreadPoolExecutor(workers, "palpate study", start_with, (start,))
        try:
            yield Pool(executor, workers)
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            end.send(None)  # wakes threads that wait for a point, which then kill its process
            executor.shutdown()
            for runner in runners:
                runner.close()


def compute(pool: Pool, task: Task, points: Iterable[Point], add: Callable[[Point, Computed], None]) -> None:
    """Compute points in a pool. `add` is called with each computed point.

    RunError: a worker computes with other versions, or a disk is full.
    """
    waiting, flight = iter(points), dict[Future[Computed], Point]()
    try:
        while True:
            for point in islice(waiting, AHEAD * pool.workers - len(flight)):
                flight[pool.executor.submit(work, task, point)] = point
            if not flight:
                return
            for future in wait(flight, timeout=1.0, return_when=FIRST_COMPLETED).done:
                point, computed = flight.pop(future), future.result()
                if computed.lost:
                    raise RunError(f"{computed.lost}; what was computed before is stored")
                add(point, computed)
    finally:
        for future in flight:
            future.cancel()
