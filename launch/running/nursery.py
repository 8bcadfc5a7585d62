"""The fork server: one process that has imported everything, from which the workers are forked.

It runs `python -m palpate.launch.running.nursery FD`, where FD is one end of a socket pair to the launcher, and takes
a JSON object a line: {"import": [modules], "inboxes": [groups]}, {"start": job, "run": ..., "control": ..., "reports":
...}, {"kill": group, "signal": n}. It answers {"started": group, "pid": n} and {"exited": group, "status": n}. When the
launcher goes, the socket closes, and the nursery and all workers end.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys

import msgspec

from palpate.launch.running.clock import die_with_parent, one_blas_thread
from palpate.launch.running.inbox import Pair, pair
from palpate.launch.running.job import Job


class Nursery:
    """The launcher's side: starts the fork server and speaks with it. `output` is the workers' stdout and stderr."""

    def __init__(self) -> None:
        self.socket, theirs = socket.socketpair()
        path = os.pathsep.join(p for p in sys.path if p)
        with theirs, one_blas_thread():
            self.process = subprocess.Popen(
                [sys.executable, "-m", "palpate.launch.running.nursery", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"},
                start_new_session=True,  # Ctrl-C reaches the launcher alone, which stops the rest in order
            )
        assert self.process.stdout is not None
        self.output = self.process.stdout
        os.set_blocking(self.output.fileno(), False)
        self._rest = b""

    def ask(self, what: dict) -> None:
        """Send one request."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.socket.sendall(json.dumps(what).encode() + b"\n")

    def answers(self) -> list[dict]:
        """All answers that have come."""
        self.socket.setblocking(False)
        try:
            while data := self.socket.recv(65536):
                self._rest += data
        except (BlockingIOError, ConnectionResetError):
            pass
        finally:
            self.socket.setblocking(True)
        *lines, self._rest = self._rest.split(b"\n")
        return [json.loads(line) for line in lines]

    def printed(self) -> str:
        """What the workers have printed since the last call."""
        found = b""
        while True:
            data = self.output.read(65536)
            if not data:
                return found.decode(errors="replace")
            found += data

    def close(self) -> str:
        """End the nursery and with it every worker that is left. Returns what they printed last."""
        if self.output.closed:
            return ""
        self.socket.close()
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        last = self.printed()
        self.output.close()
        return last


def _serve(end: socket.socket) -> None:
    wake, wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    signal.set_wakeup_fd(wake_write)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    groups: dict[int, str] = {}
    inboxes: dict[str, Pair] = {}
    rest = b""
    while True:
        ready = select.select([end.fileno(), wake], [], [])[0]
        if wake in ready:
            os.read(wake, 4096)
            _reap(end, groups)
        if end.fileno() in ready:
            data = end.recv(1 << 20)
            if not data:
                break
            rest += data
            *lines, rest = rest.split(b"\n")
            for line in lines:
                _do(end, json.loads(line), groups, inboxes)
    _end_all()


def _end_all(*_: object) -> None:
    """End every process of this session: the workers, whatever their nodes have started, and the nursery itself."""
    os.killpg(0, signal.SIGKILL)


def _do(end: socket.socket, told: dict, groups: dict[int, str], inboxes: dict[str, Pair]) -> None:
    if "import" in told:
        inboxes.update({group: pair() for group in told["inboxes"]})
        for name in told["import"]:
            with contextlib.suppress(Exception):  # the worker meets the same error and reports it
                importlib.import_module(name)
        gc.collect()
        gc.freeze()  # so that the workers' collections do not touch, and so copy, the shared pages
    elif "start" in told:
        pid = os.fork()
        if pid == 0:
            _worker(end, told, inboxes)
        groups[pid] = told["start"]["group"]
        end.sendall(json.dumps({"started": told["start"]["group"], "pid": pid}).encode() + b"\n")
    elif "kill" in told:
        for pid, group in groups.items():
            if group == told["kill"]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, told["signal"])


def _worker(end: socket.socket, told: dict, inboxes: dict[str, Pair]) -> None:
    """In the forked child: run the job and exit; never returns."""
    code = 1
    try:
        die_with_parent()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        end.close()
        from palpate.launch.running.process import serve

        job = msgspec.convert(told["start"], Job)
        code = serve(job, told["run"], told["control"], told["reports"], inboxes)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _reap(end: socket.socket, groups: dict[int, str]) -> None:
    while groups:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if pid == 0:
            return
        group = groups.pop(pid, None)
        if group is not None:
            code = os.waitstatus_to_exitcode(status)
            end.sendall(json.dumps({"exited": group, "status": code}).encode() + b"\n")


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, _end_all)
    die_with_parent(signal.SIGTERM)
    # Imported here, before the first request, so that they are shared by all workers.
    importlib.import_module("palpate.launch.running.process")
    with contextlib.suppress(ImportError):
        importlib.import_module("numba")
    _serve(socket.socket(fileno=int(sys.argv[1])))
