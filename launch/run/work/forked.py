"""A child that is forked from this process, with its imports, instead of started as a new program.

Forking a process with several threads is unsafe: a lock that another one holds stays locked in the child. `forkable`
says whether this process has one thread only.
"""

import contextlib
import gc
import os
import select
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import IO, NoReturn


def forkable() -> bool:
    """Whether this process can be forked safely: it has one thread. False where the system does not say."""
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:
        return False


class Child:
    """A child of this process, with the part of `subprocess.Popen` that a launcher uses.

    stdout  what it prints, if this process reads it
    """

    def __init__(self, pid: int, stdout: IO[bytes] | None) -> None:
        self.pid, self.stdout, self.returncode = pid, stdout, None

    returncode: int | None

    def poll(self) -> int | None:
        """Its exit code, negative for a signal; None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end. TimeoutExpired: it runs after `timeout` [s]."""
        if self.poll() is None:
            ended, end = select.poll(), os.pidfd_open(self.pid)
            try:
                ended.register(end)
                over = ended.poll(None if timeout is None else 1e3 * timeout)
            finally:
                os.close(end)
            if not over:
                raise subprocess.TimeoutExpired(f"process {self.pid}, {self._threads()}", timeout or 0.0)
            _, status = os.waitpid(self.pid, 0)
            self.returncode = os.waitstatus_to_exitcode(status)
        assert self.returncode is not None
        return self.returncode

    def _threads(self) -> str:
        """State of each thread, and the kernel function in which it waits."""
        printed = []
        for thread in Path(f"/proc/{self.pid}/task").glob("*"):
            with contextlib.suppress(OSError):
                state = (thread / "stat").read_text().rpartition(")")[2].split()[0]
                printed.append(f"{state} in {(thread / 'wchan').read_text()}")
        return "; ".join(printed)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send it a signal, if it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)


def fork(call: Callable[[], NoReturn], keep: Iterable[int], environment: Mapping[str, str]) -> Child:
    """Fork a process that runs a call in a new session, without the files and handlers of signals of this one. What it
    prints can be read from `stdout`.

    keep         numbers of the files that it keeps
    environment  its variables
    """
    reading, writing = os.pipe()
    for stream in (sys.stdout, sys.stderr):  # otherwise the child would print what this process has not yet
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    gc.freeze()  # otherwise garbage collection in the child would write to the shared pages and copy them
    # until the child has its handlers: a signal would call those of this process in it
    handled = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, handled)
    pid = os.fork()
    if pid == 0:
        try:
            _become(writing, {*keep}, environment)
            for number in handled:
                signal.signal(number, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            call()
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(1)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    gc.unfreeze()
    os.close(writing)
    return Child(pid, open(reading, "rb"))


def _become(output: int, keep: set[int], environment: Mapping[str, str]) -> None:
    os.setsid()
    signal.set_wakeup_fd(-1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for number, stream in enumerate((nothing, output, output)):
        os.dup2(stream, number)
    for number in {int(name) for name in os.listdir("/proc/self/fd")} - {0, 1, 2} - keep:
        with contextlib.suppress(OSError):  # the list of the folder itself
            os.close(number)
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.stdout = open(1, "w", buffering=1, closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
    os.environ.clear()
    os.environ.update(environment)
