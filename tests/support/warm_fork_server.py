"""Fork servers and commands for tests, forked from one process that has imported everything, which saves seconds of
imports each.

A run in the process of a test starts its fork server by `subprocess.Popen`. Here it gets a fork of a process that has
done all work of a fork server before serving. The fork is a child of the test's process, in a separate session, with
the environment, folder, paths, processors and limits of that process. If environment variables that libraries read at
import differ, the fork server is started normally.

`palpate` does the same for a command from a shell: a process with a separate environment, folder, streams and exit
code. Its fork server is forked from it before it has threads. A fork keeps its parent's `environ` in `/proc`, so
`started_in` also finds the processes of a run by their folder.
"""

import atexit
import contextlib
import ctypes
import gc
import importlib
import io
import json
import os
import platform
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

from palpate.launch.run import forkserver
from palpate.launch.run.work.forked import Child

AFTER_IMPORT = {
    "BROWSER", "COLUMNS", "DISPLAY", "PALPATE_FAULT", "PALPATE_TEST", "PYTEST_CURRENT_TEST", "PYTHONPATH",
    "PYTHONUNBUFFERED", "TMPDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_RUNTIME_DIR",
}  # fmt: skip
"""Variables that no library reads at import."""
AT_A_RUN = ("palpate.cli.terminal.run_summary", "palpate.records.times")
"""Modules that a command imports after its run."""
LIMITS = (resource.RLIMIT_AS, resource.RLIMIT_FSIZE, resource.RLIMIT_NOFILE)
CLONE, CLONE_PARENT = 56, 0x8000
"""x86-64: number of the system call, and flag that makes the child a sibling of the caller."""


class Source:
    """The process that forks, started with the first run of this process."""

    def __init__(self) -> None:
        self.environment: dict[str, str] = {}
        self.one_at_a_time = threading.Lock()
        self.process: subprocess.Popen[bytes] | None = None

    def popen(self, command: list[str], *, pass_fds: list[int], env: dict[str, str], **given: Any) -> Any:
        """Replaces `subprocess.Popen` for a fork server."""
        if not self._has(env):
            return subprocess.Popen(command, pass_fds=pass_fds, env=env, **given)
        reading, writing = os.pipe()
        with open(writing, "wb"):
            pid = self._fork([*pass_fds, writing], env=env, folder=os.getcwd())
            return Child(pid, open(reading, "rb"))

    def palpate(self, arguments: list[str], *, cwd: Path, env: dict[str, str], stdin: int = subprocess.DEVNULL,
                stdout: Any, stderr: Any, preexec_fn: Any = None, start_new_session: bool = False) -> Any:  # fmt: skip
        """`python -m palpate.cli ARGUMENTS`; with `preexec_fn` by `subprocess.Popen`."""
        if (
            platform.machine() != "x86_64"
            or preexec_fn is not None
            or stdin != subprocess.DEVNULL
            or not self._has(env)
        ):
            return subprocess.Popen(
                [sys.executable, "-m", "palpate.cli", *arguments], cwd=cwd, env=env, stdin=stdin, stdout=stdout,
                stderr=stderr, preexec_fn=preexec_fn, start_new_session=start_new_session,
            )  # fmt: skip
        streams = [stdout.fileno(), stderr.fileno()]
        return Child(self._fork(streams, env=env, folder=str(cwd), arguments=arguments, alone=start_new_session), None)

    def _has(self, env: dict[str, str]) -> bool:
        """Whether it runs with the relevant part of this environment."""
        if self.process is None:
            self._begin(env)
        return self.process.poll() is None and lasting(env) == lasting(self.environment)

    def _fork(self, descriptors: list[int], **request: Any) -> int:
        with self.one_at_a_time:
            socket.send_fds(self.socket, [json.dumps(request).encode()], descriptors)
            return int(self.socket.recv(32))

    def _begin(self, env: dict[str, str]) -> None:
        self.environment = env
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            number = theirs.fileno()
            command = [sys.executable, __file__, str(number)]
            env = lasting(env) | {"PYTHONPATH": env.get("PYTHONPATH", "")}  # without the mark of the first run
            begun = threading.Event()

            def keep() -> None:
                """Fork in a thread that never ends: the parent-death signal is sent when the forking thread ends."""
                try:
                    self.process = subprocess.Popen(command, pass_fds=[number], env=env, stdin=subprocess.DEVNULL)
                finally:
                    begun.set()
                threading.Event().wait()

            threading.Thread(target=keep, name="keeps the fork server", daemon=True).start()
            begun.wait()


SOURCE = Source()
palpate = SOURCE.palpate


def lasting(env: dict[str, str]) -> dict[str, str]:
    return {name: value for name, value in env.items() if name not in AFTER_IMPORT}


def use() -> None:
    """Use forks for all later runs of this process, on x86-64, whose system call is known here."""
    if platform.machine() != "x86_64":
        return
    forkserver.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": SOURCE.popen})


def sibling() -> int:
    """Fork, as a child of this process's parent."""
    ctypes.pythonapi.PyOS_BeforeFork()
    pid = ctypes.PyDLL(None).syscall(CLONE, CLONE_PARENT | int(signal.SIGCHLD), 0, 0, 0, 0)
    (ctypes.pythonapi.PyOS_AfterFork_Parent if pid else ctypes.pythonapi.PyOS_AfterFork_Child)()
    return pid


def started_in(folder: Path, mark: str) -> list[int]:
    """Processes in a folder, or with a mark in their environment, also orphans."""
    pids = []
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            here = entry.name.isdigit() and Path(os.readlink(entry / "cwd")) == folder.resolve()
            if here or (entry.name.isdigit() and mark.encode() in (entry / "environ").read_bytes()):
                pids.append(int(entry.name))
    return pids


def main(end: socket.socket) -> None:
    forkserver.die_with_parent()
    forkserver.load()
    for name in ("typer._adapters", "palpate.cli.__main__", "palpate.launch.run.execute", *AT_A_RUN):
        importlib.import_module(name)
    from palpate.registry import modules

    for room in ("palpate.nodes.device", "palpate.nodes.contact"):  # imported by some scene values
        modules(importlib.import_module(room))
    gc.collect()
    gc.freeze()  # otherwise garbage collection in each fork would copy the pages

    while True:
        request, descriptors, *_ = socket.recv_fds(end, 1 << 20, 2)
        if not request:
            return
        pid = sibling()
        if pid == 0:
            end.close()
            given = json.loads(request)
            command(descriptors, **given) if "arguments" in given else serve(descriptors, **given)
        end.send(b"%d" % pid)
        for number in descriptors:
            os.close(number)


def become(env: dict[str, str], folder: str, output: int, errors: int) -> None:
    """Set folder, environment and streams."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(env)
    for number, stream in enumerate((os.open(os.devnull, os.O_RDONLY), output, errors)):
        os.dup2(stream, number)


def serve(descriptors: list[int], env: dict[str, str], folder: str) -> NoReturn:
    """Run as a fork server."""
    launcher, output = descriptors
    os.setsid()
    become(env, folder, output, output)
    sys.path[:] = [folder, *env.get("PYTHONPATH", "").split(os.pathsep)]
    sys.argv = ["palpate.launch.run.forkserver", str(launcher)]
    os.sched_setaffinity(0, os.sched_getaffinity(os.getppid()))
    for limit in LIMITS:
        resource.setrlimit(limit, resource.prlimit(os.getppid(), limit))
    os.close(output)
    forkserver.main(launcher)


def command(descriptors: list[int], env: dict[str, str], folder: str, arguments: list[str], alone: bool) -> NoReturn:
    """Run as a command."""
    code = 1
    try:
        if alone:
            os.setsid()
        become(env, folder, *descriptors)
        for number in descriptors:
            os.close(number)
        sys.stdout, sys.stderr = (io.TextIOWrapper(io.FileIO(number, "w", closefd=False)) for number in (1, 2))
        sys.path[:0] = [folder, *env.get("PYTHONPATH", "").split(os.pathsep)]
        sys.argv = ["palpate", *arguments]
        tempfile.tempdir = None
        forkserver.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": below})
        from palpate.cli.__main__ import main

        main()
    except SystemExit as end:
        code = 0 if end.code is None else end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def below(_: list[str], *, pass_fds: list[int], env: dict[str, str], **given: Any) -> Child:
    """The fork server of a command, forked from it instead of started by `subprocess.Popen`."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        for number in set(map(int, os.listdir("/proc/self/fd"))) - {0, 1, 2, writing, *pass_fds}:
            with contextlib.suppress(OSError):
                os.close(number)
        serve([*pass_fds, writing], env, os.getcwd())
    os.close(writing)
    return Child(pid, open(reading, "rb"))


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
