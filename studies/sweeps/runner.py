"""What a worker of a study does: it hands points to a process of its own, and kills it when a point takes too long."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import IO

from palpate.physics.arithmetic import environment
from palpate.physics.errors import RunError
from palpate.studies.sweeps.point import Computed, Point, Task

SERVE = "from palpate.studies.sweeps.point import main; main()"
STARTS = 120.0  # [s] for the process to come up


class Runner:
    """A process that computes points, and the connection to it.

    env      environment variables in addition to those of this process
    printed  file for what it prints; None: where this process prints
    ended    readable as soon as the pool ends: the process is then killed; None: it ends with this thread
    """

    def __init__(
        self, env: Mapping[str, str] | None = None, printed: IO[bytes] | None = None, ended: Connection | None = None
    ) -> None:
        self.link, theirs = Pipe()
        self._awaited = [self.link] if ended is None else [self.link, ended]
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-c", SERVE, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=printed,
                stderr=printed and subprocess.STDOUT,
                env={
                    **environment(),
                    "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                    **(env or {}),
                },
                process_group=0,  # Ctrl-C reaches the study alone
            )
        if not self._answers(STARTS):
            self.close()
            raise RunError(f"the process that computes points did not start within {STARTS:g} s")
        try:
            self.about: dict[str, str] = self.link.recv()
        except (EOFError, OSError):
            told = f"; {printed.name} has what it printed" if printed else ""
            raise RunError(f"the process that computes points ended at its start: {self._ending()}{told}") from None

    def run(self, task: Task, point: Point) -> Computed:
        """Compute a point. The process ends with a point that takes too long, or that takes it down."""
        since = time.monotonic()
        try:
            self.link.send((task, point))
            while True:
                until = None if task.limit is None else max(0.0, since + task.limit - time.monotonic())
                if not self._answers(until):
                    self.close()
                    return Computed(error=f"took longer than {task.limit:g} s", seconds=task.limit or 0.0)
                done = self.link.recv()
                if done is not None:
                    return done
                since = time.monotonic()  # what it had to compile before does not count
        except (EOFError, OSError):
            return Computed(error=f"its process ended: {self._ending()}", seconds=time.monotonic() - since)

    def _answers(self, seconds: float | None) -> bool:
        """Whether the process sends something, or ends, in this time. CancelledError: the pool ended."""
        ready = wait(self._awaited, seconds)
        if ready and self.link not in ready:
            self.close()
            raise CancelledError
        return bool(ready)

    def _ending(self) -> str:
        """Why the process is gone."""
        self.link.close()
        code = self.process.wait()
        return f"exit code {code}" if code >= 0 else signal.Signals(-code).name

    @property
    def alive(self) -> bool:
        return not self.link.closed and self.process.poll() is None

    def close(self) -> None:
        if self.process.poll() is None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self._ending()


_here = threading.local()


def start_with(start: Callable[[], Runner]) -> None:
    """Have this thread start its process by a function."""
    _here.start = start


def work(task: Task, point: Point) -> Computed:
    """Compute a point in this thread's process.

    RunError: the process computes with other versions than the study's, as after an edit of the sources.
    """
    runner = getattr(_here, "runner", None)
    if runner is None or not runner.alive:
        runner = _here.runner = _here.start()
    other = [
        f"{name} {runner.about.get(name, 'none')} there, {ours} here"
        for name, ours in task.about.items()
        if runner.about.get(name) != ours
    ]
    if other:
        raise RunError(f"a new process would not give the same bytes: {'; '.join(other)}")
    return runner.run(task, point)
