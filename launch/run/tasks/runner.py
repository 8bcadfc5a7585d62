"""Computes blocks of items in a child process, on any executor: each thread that computes has one."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError
from multiprocessing.connection import Connection, wait
from typing import IO

from palpate.compiler.arithmetic import environment
from palpate.launch.run.tasks.link import STARTS, open_link
from palpate.launch.run.tasks.task import Ended
from palpate.physics.errors import RunError

SERVE = "from palpate.launch.run.tasks.child import main; main()"

_here = threading.local()


class Runner:
    """A process that computes items, and the connection to it.

    env      additional environment variables
    printed  file for its output; None: the output of this process
    ended    connection that becomes readable when the pool ends, upon which the process is killed; None: the process
             ends with this thread
    """

    def __init__(
        self, env: Mapping[str, str] | None = None, printed: IO[bytes] | None = None, ended: Connection | None = None
    ) -> None:
        self._task = b""  # the last task that the process received
        self.process, self.link = open_link(
            [sys.executable, "-c", SERVE],
            stdout=printed,
            stderr=printed and subprocess.STDOUT,
            env={**environment(), "PYTHONPATH": os.pathsep.join(path for path in sys.path if path), **(env or {})},
            process_group=0,  # Ctrl-C reaches only the study
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        self._awaited = [self.link] if ended is None else [self.link, ended]
        if not self._answers(STARTS):
            self.close()
            raise RunError(f"the process that computes points did not start within {STARTS:g} s")
        try:
            self.about: dict[str, str] = self.link.recv()
        except (EOFError, OSError):
            output = f"; {printed.name} has what it printed" if printed else ""
            raise RunError(f"the process that computes points ended at its start: {self._ending()}{output}") from None

    def run(self, task: bytes, items: Sequence[bytes], limit: float | None) -> list[bytes | Ended | None]:
        """Compute the items of a task. The process is killed if one of them takes too long, and may crash.

        An item that was not computed before the process ended has None, or if it is the only one, `Ended`. RunError:
        this machine cannot compute the task.
        """
        results: list[bytes | Ended | None] = [None] * len(items)
        since = time.monotonic()
        try:
            self.link.send((None if task == self._task else task, items))
            self._task = task
            while True:
                until = None if limit is None else max(0.0, since + limit - time.monotonic())
                if not self._answers(until):
                    self.close()
                    ended = Ended(f"took longer than {limit:g} s", limit or 0.0)
                    break
                match self.link.recv():
                    case ():
                        return results
                    case str(text):
                        self._task = b""
                        raise RunError(f"{socket.gethostname()}: {text}")
                    case (place, result):
                        results[place] = result
                since = time.monotonic()
        except (EOFError, OSError):
            ended = Ended(f"its process ended: {self._ending()}", time.monotonic() - since)
        return [ended] if len(items) == 1 else results

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
                if hasattr(os, "killpg"):
                    os.killpg(self.process.pid, signal.SIGKILL)
                else:
                    self.process.kill()
        self._ending()


def starts_with(start: Callable[[], Runner]) -> None:
    """Let this thread start its process with this function."""
    _here.start = start


def runner() -> Runner:
    """The process of this thread, started if necessary."""
    known: Runner | None = getattr(_here, "runner", None)
    if known is None or not known.alive:
        known = _here.runner = getattr(_here, "start", Runner)()
    return known


def work(
    about: Mapping[str, str], task: bytes, items: Sequence[bytes], limit: float | None
) -> tuple[str, float, list[bytes | Ended | None]]:
    """Compute a block of items. An executor calls it in any process on any machine, also repeatedly.

    about  versions and hashes that the process that computes must agree in

    Returns the name of the worker, the time that the block took [s], and a pickled result for each item. If the process
    crashes or is killed, the remaining items are computed one by one, so that only those that cause it have no result.

    RunError: the versions or the files of this machine differ, for example after an edit of the sources.
    """
    there = runner().about
    pairs = ((name, there.get(name, "none"), about.get(name, "none")) for name in {**about, **there})
    other = [f"{name} {theirs} there, {ours} here" for name, theirs, ours in pairs if theirs != ours]
    if other:
        raise RunError(f"a process on {socket.gethostname()} would not give the same bytes: {'; '.join(other)}")
    since = time.monotonic()
    results = runner().run(task, items, limit)
    for place, result in enumerate(results):
        if result is None:
            (results[place],) = runner().run(task, [items[place]], limit)
    name = f"{socket.gethostname()} {os.getpid()} {threading.get_ident()}"
    return name, time.monotonic() - since, results
