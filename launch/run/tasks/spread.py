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
    shared, at, number = pickle.dumps(task), 0, 0
    done: queue.SimpleQueue[int] = queue.SimpleQueue()
    flight: dict[int, tuple[Any, Sequence[Any]]] = {}
    workers: set[str] = set()
    each = math.inf  # [s] recent time of an item

    def take_block(number: int) -> Finished:
        nonlocal each
        future, block = flight.pop(number)
        worker, seconds, results = future.result()
        workers.add(worker)
        mean = seconds / len(block)
        each = min(mean, 0.5 * (each + mean))  # the first ones also start processes and compile
        found = [one if isinstance(one, Ended) else pickle.loads(one) for one in results]
        return list(zip(block, found, strict=True))

    def wait_for_block() -> int:
        silent = False
        while True:
            try:
                return done.get(timeout=SILENT)
            except queue.Empty:
                if not silent and (silent := _has_no_workers(executor)):
                    report("the cluster has no workers now; this waits for one. Ctrl-C keeps what is finished")

    lost: BaseException | None = None
    try:
        while flight or (at < len(items) and lost is None):
            try:
                while lost is None and at < len(items) and len(flight) < max(FIRST, AHEAD * len(workers)):
                    share = (len(items) - at) / (2.0 * max(1, len(workers)))
                    block = items[at : at + max(1, math.floor(min(BLOCK / max(each, 1e-6), share)))]
                    given = [pickle.dumps(item) for item in block]
                    future = executor.submit(work, about, shared, given, task.limit)
                    flight[number] = future, block
                    future.add_done_callback(lambda _, one=number: done.put(one))
                    at, number = at + len(block), number + 1
                finished = take_block(wait_for_block())
            except LOST as error:
                lost = lost or error
                for future, _ in flight.values():  # blocks that are computed now still count
                    future.cancel()
            else:
                add(finished)
    finally:
        for future, _ in flight.values():
            future.cancel()
    if isinstance(lost, PalpateError):
        raise lost
    if lost is not None:
        text = " ".join(f"{type(lost).__name__}: {lost}".split())
        raise RunError(f"the executor lost a block ({text[:300]}); what was computed before is stored") from lost


def _has_no_workers(executor: Any) -> bool:
    """Whether this is a Dask client whose scheduler has no workers. Unknown for other executors."""
    return callable(getattr(executor, "scheduler_info", None)) and not executor.scheduler_info().get("workers")
