"""Fork servers for tests, forked from one process that has imported everything, instead of a second of imports each.

A run that a test starts in its own process starts its fork server by `subprocess.Popen`. Here it gets a fork of a
process that has come as far as a fork server comes before it serves. Like the other it is a child of the test's
process, in a session of its own, with that process's environment, folder, paths, processors and limits. Where the
environment differs in what libraries read when they are imported, the fork server is started as always; so are those
of runs that a test starts from the shell.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace
from typing import Any, NoReturn

from palpate.launch.run import forkserver

AFTER_IMPORT = {
    "BROWSER", "COLUMNS", "DISPLAY", "PYTEST_CURRENT_TEST", "PYTHONPATH", "PYTHONUNBUFFERED", "XDG_CONFIG_HOME",
    "XDG_RUNTIME_DIR",
}  # fmt: skip
"""Variables that nothing reads while it is imported."""
LIMITS = (resource.RLIMIT_AS, resource.RLIMIT_FSIZE, resource.RLIMIT_NOFILE)
CLONE, CLONE_PARENT = 56, 0x8000
"""Of x86-64: the number of the call, and the flag that the child is the caller's sibling."""


class Forked:
    """A child that others have forked, with what the launcher uses of `subprocess.Popen`."""

    def __init__(self, pid: int, stdout: Any) -> None:
        self.pid, self.stdout, self.returncode = pid, stdout, None

    def poll(self) -> int | None:
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        until = time.monotonic() + (1e9 if timeout is None else timeout)
        while self.poll() is None:
            if time.monotonic() > until:
                raise subprocess.TimeoutExpired("fork server", timeout or 0.0)
            time.sleep(5e-4)
        return self.returncode

    def terminate(self) -> None:
        self._send(signal.SIGTERM)

    def kill(self) -> None:
        self._send(signal.SIGKILL)

    def _send(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)


class Source:
    """The process that is forked from, started with the first run of this process."""

    def __init__(self) -> None:
        self.environment: dict[str, str] = {}
        self.one_at_a_time = threading.Lock()
        self.process: subprocess.Popen[bytes] | None = None

    def popen(self, command: list[str], *, pass_fds: list[int], env: dict[str, str], **given: Any) -> Any:
        """In place of `subprocess.Popen` for a fork server."""
        if self.process is None:
            self._begin(env)
        if self.process.poll() is not None or lasting(env) != lasting(self.environment):
            return subprocess.Popen(command, pass_fds=pass_fds, env=env, **given)
        reading, writing = os.pipe()
        request = json.dumps({"env": env, "folder": os.getcwd()}).encode()
        with self.one_at_a_time, open(writing, "wb"):
            socket.send_fds(self.socket, [request], [*pass_fds, writing])
            return Forked(int(self.socket.recv(32)), open(reading, "rb"))

    def _begin(self, env: dict[str, str]) -> None:
        self.environment = env
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            number = theirs.fileno()
            command = [sys.executable, __file__, str(number)]
            self.process = subprocess.Popen(command, pass_fds=[number], env=env, stdin=subprocess.DEVNULL)


SOURCE = Source()


def lasting(env: dict[str, str]) -> dict[str, str]:
    return {name: value for name, value in env.items() if name not in AFTER_IMPORT}


def use() -> None:
    """From now on, for all runs of this process, on the one architecture whose system call is known here."""
    if platform.machine() != "x86_64":
        return
    forkserver.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": SOURCE.popen})


def sibling() -> int:
    """Fork, as a child of this process's parent."""
    ctypes.pythonapi.PyOS_BeforeFork()
    pid = ctypes.PyDLL(None).syscall(CLONE, CLONE_PARENT | int(signal.SIGCHLD), 0, 0, 0, 0)
    (ctypes.pythonapi.PyOS_AfterFork_Parent if pid else ctypes.pythonapi.PyOS_AfterFork_Child)()
    return pid


def main(end: socket.socket) -> None:
    forkserver.die_with_parent()
    forkserver.load()
    while True:
        request, descriptors, *_ = socket.recv_fds(end, 1 << 20, 2)
        if not request:
            return
        pid = sibling()
        if pid == 0:
            end.close()
            serve(descriptors, **json.loads(request))
        end.send(b"%d" % pid)
        for number in descriptors:
            os.close(number)


def serve(descriptors: list[int], env: dict[str, str], folder: str) -> NoReturn:
    """What the fork becomes."""
    launcher, output = descriptors
    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(env)
    sys.path[:] = [folder, *env["PYTHONPATH"].split(os.pathsep)]
    sys.argv = ["palpate.launch.run.forkserver", str(launcher)]
    os.sched_setaffinity(0, os.sched_getaffinity(os.getppid()))
    for limit in LIMITS:
        resource.setrlimit(limit, resource.prlimit(os.getppid(), limit))
    for number in (1, 2):
        os.dup2(output, number)
    os.close(output)
    forkserver.main(launcher)


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
