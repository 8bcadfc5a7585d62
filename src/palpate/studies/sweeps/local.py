"""Workers on this machine: threads of this process, each with a child process that computes its points.

They communicate through unnamed pipes, without ports or names in the file system. Other users of the machine or the
network therefore cannot send work to them.
"""

import contextlib
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from multiprocessing import Pipe
from pathlib import Path

from palpate.compiler.cores import usable_cores
from palpate.physics.errors import RunError
from palpate.studies.sweeps.point import Computed, Point, Task
from palpate.studies.sweeps.runner import Runner

AHEAD = 2  # Points per worker in the queue of the pool, so that a worker never waits for its next point


class Pool:
    """Threads, each of which computes one point at a time, in a process that `start` makes, before the first point."""

    def __init__(self, workers: int, start: Callable[[], Runner]) -> None:
        self.workers, self._start, self._here = workers, start, threading.local()
        self.executor = ThreadPoolExecutor(workers, "palpate study")
        for _ in range(workers):
            self.executor.submit(self._runner)  # if it fails, so does the first point, with the error

    def _runner(self) -> Runner:
        """The process of this thread, started if necessary."""
        runner: Runner | None = getattr(self._here, "runner", None)
        if runner is None or not runner.alive:
            runner = self._here.runner = self._start()
        return runner

    def work(self, task: Task, point: Point) -> Computed:
        """Compute a point in the process of this thread.

        RunError: the versions of the process differ from those of the study, for example after an edit of the sources.
        """
        runner = self._runner()
        there = runner.about
        pairs = ((name, there.get(name, "none"), ours) for name, ours in task.about.items())
        other = [f"{name} {theirs} there, {ours} here" for name, theirs, ours in pairs if theirs != ours]
        if other:
            raise RunError(f"a new process would not give the same bytes: {'; '.join(other)}")
        return runner.run(task, point)


def cores() -> int:
    """Number of cores that this process may use."""
    return len(usable_cores())


@contextlib.contextmanager
def local(workers: int, log: Path) -> Iterator[Pool]:
    """A pool that ends all its threads and processes on exit; the output of the processes goes to a file, which is
    removed if it is empty, as are new folders."""
    new = [folder for folder in (log.parent, *log.parent.parents) if not folder.exists()]
    log.parent.mkdir(parents=True, exist_ok=True)
    ended, end = Pipe(duplex=False)
    runners: list[Runner] = []
    with (
        tempfile.TemporaryDirectory(prefix="palpate-study-", ignore_cleanup_errors=True) as scratch,
        open(log, "wb") as printed,
        ended,
        end,
    ):

        def start() -> Runner:
            # A killed process leaves its files in `scratch`, which the pool removes.
            runners.append(Runner({"TMPDIR": scratch}, printed, ended))
            return runners[-1]

        pool = Pool(workers, start)
        try:
            yield pool
        finally:
            pool.executor.shutdown(wait=False, cancel_futures=True)
            end.send(None)  # wakes threads that wait for a point, which then kill its process
            pool.executor.shutdown()
            for runner in runners:
                runner.close()
            if not log.stat().st_size:
                log.unlink()
                with contextlib.suppress(OSError):
                    for made in new:
                        made.rmdir()


def compute(pool: Pool, task: Task, points: Iterable[Point], add: Callable[[Point, Computed], None]) -> None:
    """Compute points in a pool, and call `add` with each result.

    RunError: a worker has other versions, or the disk is full.
    """
    waiting, flight = iter(points), dict[Future[Computed], Point]()
    try:
        while True:
            for point in islice(waiting, AHEAD * pool.workers - len(flight)):
                flight[pool.executor.submit(pool.work, task, point)] = point
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
