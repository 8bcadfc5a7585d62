"""The executor of this machine: threads of this process, each with a child process that computes.

They communicate through unnamed pipes, without ports or names in the file system, on Windows through TCP on loopback
with a secret (`link`). Other users of the machine or the network therefore cannot send work to them.
"""

import contextlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import Pipe
from pathlib import Path

from palpate.compiler.cores import usable_cores
from palpate.launch.run.tasks.runner import Runner, runner, starts_with
from palpate.physics.scratch import ScratchFolder


def cores() -> int:
    """Number of cores that this process may use."""
    return len(usable_cores())


@contextlib.contextmanager
def local(workers: int, log: Path) -> Iterator[ThreadPoolExecutor]:
    """An executor that ends all its threads and processes on exit; the output of the processes goes to a file, which is
    removed if it is empty, as are new folders."""
    new = [folder for folder in (log.parent, *log.parent.parents) if not folder.exists()]
    log.parent.mkdir(parents=True, exist_ok=True)
    ended, end = Pipe(duplex=False)
    runners: list[Runner] = []
    with (
        ScratchFolder("study") as scratch,
        open(log, "wb") as printed,
        ended,
        end,
    ):

        def start() -> Runner:
            # A killed process leaves its files in `scratch`, which is removed.
            runners.append(Runner(dict.fromkeys(("TMPDIR", "TEMP", "TMP"), scratch), printed, ended))
            return runners[-1]

        executor = ThreadPoolExecutor(workers, "palpate study", starts_with, (start,))
        for _ in range(workers):
            executor.submit(runner)  # before the first block; if it fails, so does the block, with the error
        try:
            yield executor
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            end.send(None)  # wakes threads that wait for a result, which then kill their process
            executor.shutdown()
            for each in runners:
                each.close()
            printed.close()  # Windows removes no open file
            if not log.stat().st_size:
                log.unlink()
                with contextlib.suppress(OSError):
                    for made in new:
                        made.rmdir()
