"""Workers of this machine: threads of this process, each with a process below it that computes its points.

They talk through unnamed pipes. Nothing listens on a port or has a name in the file system, so no other user of the
machine and nobody on the network can send work to them.
"""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import Pipe
from pathlib import Path

from palpate.studies.sweeps.batches import Pool
from palpate.studies.sweeps.runner import Runner, start_with


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
