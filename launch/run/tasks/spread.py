"""Spreads the items of a task over an executor, in blocks of a few seconds."""

import asyncio
import math
import pickle
import queue
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from palpate.launch.run.tasks.runner import work
from palpate.launch.run.tasks.task import Ended, Task
from palpate.physics.errors import ArgumentError, PalpateError, RunError

BLOCK = 2.0  # [s] of a block of items
FIRST, AHEAD = 32, 3
"""Number of blocks that are submitted before the first worker has answered, and for each worker that has. An executor
does not say how many workers it has, and a cluster may change their number."""

SILENT = 10.0  # [s] without a finished block, after which a cluster without workers is reported

LOST = (Exception, asyncio.CancelledError)  # what the result of a lost block raises
Finished = list[tuple[Any, Any | Ended]]
"""Items of a finished block, each with its result."""


class Executor(Protocol):
    """Anything with `submit`: `concurrent.futures`, `dask.distributed.Client`, `mpi4py.futures`, `loky`."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Any:
        """A future, with `result`, `cancel` and `add_done_callback`."""


def spread(
    executor: Executor,
    about: dict[str, str],
    task: Task,
    items: Sequence[Any],
    add: Callable[[Finished], None],
    report: Callable[[str], None] = lambda text: None,
) -> None:
    """Compute items on an executor, and call `add` with those that are finished, in any order.

    about   versions and hashes that the workers must agree in
    report  called with a line if a Dask cluster has no workers

    RunError: a worker has other versions or files, or the executor lost a block, as when its scheduler ended. `add`
    then has all that was finished before, as after Ctrl-C. ArgumentError: the executor has no `submit`.
    """
    if not callable(getattr(executor, "submit", None)):
        raise ArgumentError(f"executor: found {executor!r}, expected one with `submit`, as of concurrent.futures")
    flight = _Flight(executor, about, task, items)
    lost: BaseException | None = None
    try:
        while flight.blocks or (flight.rest and lost is None):
            try:
                if lost is None:
                    flight.submit()
                finished = flight.take_block(report)
            except LOST as error:
                lost = lost or error
                flight.cancel()  # blocks that are computed now still count
            else:
                add(finished)
    finally:
        flight.cancel()
    if isinstance(lost, PalpateError):
        raise lost
    if lost is not None:
        text = " ".join(f"{type(lost).__name__}: {lost}".split())
        raise RunError(f"the executor lost a block ({text[:300]}); what was computed before is stored") from lost


class _Flight:
    """The blocks that are submitted and not yet finished, and the items that are left.

    blocks  future and items of each, by number
    rest    number of items that are left
    """

    def __init__(self, executor: Executor, about: dict[str, str], task: Task, items: Sequence[Any]) -> None:
        self._executor, self._about, self._shared, self._limit = executor, about, pickle.dumps(task), task.limit
        self._items, self._number = items, 0
        self.rest, self.blocks = len(items), dict[int, tuple[Any, Sequence[Any]]]()
        self._done: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._workers: set[str] = set()
        self._each = math.inf  # [s] recent time of an item

    def submit(self) -> None:
        """Submit blocks for all workers that are known."""
        while self.rest and len(self.blocks) < max(FIRST, AHEAD * len(self._workers)):
            share = self.rest / (2.0 * max(1, len(self._workers)))
            at, size = len(self._items) - self.rest, max(1, math.floor(min(BLOCK / max(self._each, 1e-6), share)))
            block = self._items[at : at + size]
            given = [pickle.dumps(item) for item in block]
            future = self._executor.submit(work, self._about, self._shared, given, self._limit)
            self.blocks[self._number] = future, block
            future.add_done_callback(lambda _, one=self._number: self._done.put(one))
            self.rest, self._number = self.rest - len(block), self._number + 1

    def take_block(self, report: Callable[[str], None]) -> Finished:
        """Wait for a block and return its results."""
        future, block = self.blocks.pop(self._wait(report))
        worker, seconds, results = future.result()
        self._workers.add(worker)
        mean = seconds / len(block)
        self._each = min(mean, 0.5 * (self._each + mean))  # the first ones also start processes and compile
        found = [one if isinstance(one, Ended) else pickle.loads(one) for one in results]
        return list(zip(block, found, strict=True))

    def cancel(self) -> None:
        """Cancel what no worker has begun."""
        for future, _ in self.blocks.values():
            future.cancel()

    def _wait(self, report: Callable[[str], None]) -> int:
        """The number of the next finished block."""
        silent = False
        while True:
            try:
                return self._done.get(timeout=SILENT)
            except queue.Empty:
                if not silent and (silent := _has_no_workers(self._executor)):
                    report("the cluster has no workers now; this waits for one. Ctrl-C keeps what is finished")


def _has_no_workers(executor: Any) -> bool:
    """Whether this is a Dask client whose scheduler has no workers. Unknown for other executors."""
    return callable(getattr(executor, "scheduler_info", None)) and not executor.scheduler_info().get("workers")
