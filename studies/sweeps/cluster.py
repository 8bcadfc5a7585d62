"""Where the points of a study are computed: workers of Dask here, on a cluster, or wherever a client is connected to.

One worker has one thread and computes one point at a time. What is stored decides what is left to do, not Dask: a
scheduler that goes takes nothing with it but the points under way.
"""

import contextlib
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from palpate.physics.errors import ArgumentError, PalpateError, RunError
from palpate.physics.extras import missing
from palpate.studies.sweeps.point import Computed, Point, Task
from palpate.studies.sweeps.runner import ENOUGH, local_cache, work

try:
    import distributed
except ImportError as error:
    raise RunError(missing("studies", error.name, "study")) from None

MOST = 500  # points in a task
AHEAD = 2  # tasks for each worker that the scheduler knows: the next one is there when one ends
CONNECTS = 10.0  # [s] in which a scheduler answers
DEATHS = 2  # of a worker under one point alone, after which the point is to blame
_WORKERS = (
    "from palpate.launch.run.descendants import die_with_parent; die_with_parent(); "
    "from distributed.cli.dask_worker import main; main()"
)


def cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0))


@contextlib.contextmanager
def local(workers: int, log: Path) -> Iterator[tuple[distributed.Client, Callable[[], None]]]:
    """A scheduler in this process, and workers below it that end with it; what they print goes to a file.

    Gives a client, and a function that raises RunError where the workers could not start, or are gone.
    """
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", silence_logs=50) as cluster,
        distributed.Client(cluster) as client,
        tempfile.TemporaryDirectory(prefix="palpate-study-", ignore_cleanup_errors=True) as scratch,
        open(log, "wb") as printed,
    ):
        options = ["--nworkers", str(workers), "--nthreads", "1", "--no-dashboard", "--death-timeout", "60"]
        process = subprocess.Popen(
            [sys.executable, "-c", _WORKERS, cluster.scheduler_address, *options],
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=subprocess.STDOUT,
            process_group=0,  # Ctrl-C reaches the study alone
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                "TMPDIR": scratch,  # what they leave there when they are killed goes with it
                **({"NUMBA_CACHE_DIR": cache} if (cache := local_cache()) else {}),
            },
        )

        def alive() -> None:
            if process.poll() is not None:
                raise RunError(f"the workers ended with exit code {process.returncode}; {log} has what they printed")

        try:
            yield client, alive
        finally:
            process.kill()
            process.wait()


def connect(address: str) -> distributed.Client:
    """A client of a scheduler. RunError: there is none."""
    try:
        return distributed.Client(address, timeout=CONNECTS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RunError(f"no scheduler of Dask at {address}: {' '.join(str(error).split())}") from None


def slurm(options: Mapping[str, Any]) -> Any:
    """A cluster of SLURM, no job submitted yet: the keywords of `dask_jobqueue.SLURMCluster` but for the processes, as
    each core is a worker. ArgumentError: one that it does not take."""
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError as error:
        raise RunError(missing("SLURM", error.name, "study")) from None
    given = {"cores": 1, "memory": "2 GB", "scheduler_options": {"dashboard_address": ":0"}, **options}
    given.pop("jobs", None)
    threads = [f"export {name}=1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")]
    given["job_script_prologue"] = [*threads, *given.get("job_script_prologue", ())]
    try:
        return SLURMCluster(**given | {"processes": given["cores"]})
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"slurm: {error}") from None


@contextlib.contextmanager
def submitted(options: Mapping[str, Any]) -> Iterator[distributed.Client]:
    """A client of a cluster of SLURM whose jobs are in the queue. RunError: this machine has no SLURM."""
    if shutil.which("sbatch") is None:
        raise RunError("no `sbatch` here: run this on a login node of the cluster, or see the script with --job-script")
    with slurm(options) as cluster:
        cluster.scale(jobs=options.get("jobs", 1))
        with distributed.Client(cluster, set_as_default=False) as client:
            yield client


def compute(
    client: distributed.Client,
    task: Task,
    points: Sequence[Point],
    add: Callable[[Point, Computed, str], None],
    waits: Callable[[], None],
) -> None:
    """Compute points on the workers of a client. `add` is called with each as it is done and the name of its machine,
    `waits` about once a second where no worker is there.

    RunError: the scheduler is lost, a worker computes with other versions, or a disk is full.
    """
    waiting, deaths = deque(points), Counter[str]()
    flight: dict[distributed.Future, list[Point]] = {}
    seconds = ENOUGH
    try:
        while waiting or flight:
            workers = sum(client.nthreads().values())
            if not workers:
                waits()
            while waiting and len(flight) < AHEAD * max(1, workers):
                share = math.ceil(len(waiting) / (AHEAD * max(1, workers)))
                size = 1 if deaths[waiting[0].key] else max(1, min(int(ENOUGH / seconds), share, MOST))
                batch = [waiting.popleft() for _ in range(size)]
                flight[client.submit(work, task, batch, pure=False)] = batch
            for future in _finished(flight):
                batch = flight.pop(future)
                machine, done = _result(future, batch, deaths)
                waiting.extendleft(reversed(batch[len(done) :]))
                for point, one in zip(batch, done, strict=False):
                    if one.lost:
                        raise RunError(f"{machine}: {one.lost}; what was computed before is stored")
                    seconds += 0.2 * (max(one.seconds, 1e-3) - seconds)
                    add(point, one, machine)
    except (OSError, CancelledError) as error:
        address = client.scheduler.addr if client.scheduler else "the scheduler"
        raise RunError(
            f"{address}: the scheduler is lost. What was computed before is stored; run the study again to go on"
        ) from error
    finally:
        with contextlib.suppress(Exception):  # nothing to cancel where the scheduler is gone
            client.cancel(list(flight), force=True)


def _finished(flight: Mapping[distributed.Future, Any]) -> list[distributed.Future]:
    with contextlib.suppress(TimeoutError):
        distributed.wait(list(flight), timeout=1.0, return_when="FIRST_COMPLETED")
    return [future for future in flight if future.done()]


def _result(future: distributed.Future, batch: list[Point], deaths: Counter[str]) -> tuple[str, list[Computed]]:
    """What a task has done. A worker that dies under it, again and again, is the fault of its only point."""
    try:
        return future.result()
    except distributed.KilledWorker as error:
        deaths.update(point.key for point in batch)
        if len(batch) == 1 and deaths[batch[0].key] >= DEATHS:
            return str(error.last_worker), [Computed(error="the worker died under it, again and again")]
        return "", []
    except (PalpateError, CancelledError, OSError):
        raise
    except Exception as error:
        raise RunError(
            f"a worker cannot compute: {type(error).__name__}: {error}; is palpate installed there?"
        ) from error
