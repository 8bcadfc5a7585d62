"""Worker of a study: passes points to its child process, and kills it if a point takes too long."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from concurrent.futures import CancelledError
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import IO

from palpate.compiler.arithmetic import environment
from palpate.physics.errors import RunError
from palpate.studies.sweeps.point import Computed, Point, Task

SERVE = "from palpate.studies.sweeps.point import main; main()"
STARTS = 120.0  # [s] Timeout of the start of the process


class Runner:
    """A process that computes points, and the connection to it.

    env      additional environment variables
    printed  file for its output; None: the output of this process
    ended    connection that becomes readable when the pool ends, upon which the process is killed; None: the process
             ends with this thread
    """

    def __init__(
        self, env: Mapping[str, str] | None = None, printed: IO[bytes] | None = None, ended: Connection | None = None
    ) -> None:
        if sys.platform == "win32":
            raise RunError("found Windows, expected Linux or macOS: a study computes its points in processes")
        self.link, theirs = Pipe()
        self._task: Task | None = None  # the last task that the process received
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
                process_group=0,  # Ctrl-C reaches only the study
            )
        if not self._answers(STARTS):
            self.close()
            raise RunError(f"the process that computes points did not start within {STARTS:g} s")
        try:
            self.about: dict[str, str] = self.link.recv()
        except (EOFError, OSError):
            output = f"; {printed.name} has what it printed" if printed else ""
            raise RunError(f"the process that computes points ended at its start: {self._ending()}{output}") from None

    def run(self, task: Task, point: Point) -> Computed:
        """Compute a point. The process is killed if the point takes too long, and may crash with it."""
        since = time.monotonic()
        try:
            self.link.send((None if task is self._task else task, point))
            self._task = task
            while True:
                until = None if task.limit is None else max(0.0, since + task.limit - time.monotonic())
                if not self._answers(until):
                    self.close()
                    return Computed(error=f"took longer than {task.limit:g} s", seconds=task.limit or 0.0)
                done = self.link.recv()
                if done is not None:
                    return done
                since = time.monotonic()  # compilation before it does not count
        except (EOFError, OSError):
            return Computed(error=f"its process ended: {self._ending()}", seconds=time.monotonic() - since)

    def _answers(self, seconds: float | None) -> bool:
        """Whether the process sends a message or ends within this time. CancelledError: the pool ended."""
        ready = wait(self._awaited, seconds)
        if ready and self.link not in ready:
            self.close()
            raise CancelledError
        return bool(ready)

    def _ending(self) -> str:
        """Exit code or signal of the ended process."""
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
