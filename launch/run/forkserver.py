"""The fork server: a process that imports everything once, and from which the workers are forked.

It runs `python -m palpate.launch.run.forkserver FD`, where FD is one end of a socket pair to the launcher, or is forked
from the launcher, which then has imported most modules already. Requests and answers are JSON objects, one per line
(`reports`). When the launcher ends, the socket closes, and the fork server kills all workers and exits.

Each worker leads a process group: when the worker ends, the fork server kills that group.
"""

import contextlib
import gc
import importlib
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from typing import NoReturn

import msgspec
import zmq

from palpate.compiler.arithmetic import environment
from palpate.launch.run.descendants import die_with_parent, set_title
from palpate.launch.run.reports import ANSWERS, REPORTED, REQUESTS, Exited, Kill, Prepare, Start, Started
from palpate.launch.run.work.activity import activity
from palpate.launch.run.work.forked import Child, fork, forkable
from palpate.registry import with_room

COLLECTION = (700, 10, 10)  # Python's thresholds of garbage collection, whose pauses are the shortest
MOST_PRINTED = 1 << 20  # [bytes] of output read at once, so that a flood of output does not block the launcher


class ForkServer:
    """The launcher's side of the fork server. `output` is the stdout and stderr of the workers.

    forked  fork it from this process, if that is safe. It inherits the files, modules and state of this process, so
            only a process that palpate has started itself should ask for it
    """

    look = staticmethod(activity)
    """What the process with an id does; None: unknown."""

    def __init__(self, forked: bool = False) -> None:
        self.socket, theirs = socket.socketpair()
        path = os.pathsep.join(p for p in sys.path if p)
        env = {**environment(), "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
        number = theirs.fileno()
        self.process: subprocess.Popen[bytes] | Child
        with theirs:
            if forked and forkable():
                self.process = fork(lambda: main(number, _load_worker), [number], env)
            else:
                self.process = subprocess.Popen(
                    [sys.executable, "-m", "palpate.launch.run.forkserver", str(number)],
                    pass_fds=[number],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    env=env,
                    start_new_session=True,  # Ctrl-C reaches only the launcher, which shuts the workers down
                )
        assert self.process.stdout is not None
        self.output = self.process.stdout
        os.set_blocking(self.output.fileno(), False)
        self._rest = b""

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    @property
    def pid(self) -> int:
        return self.process.pid

    def register(self, poller: zmq.Poller) -> None:
        """Wake this poller on answers and output."""
        poller.register(self.socket.fileno(), zmq.POLLIN)
        poller.register(self.output.fileno(), zmq.POLLIN)

    def ask(self, request: Prepare | Start | Kill) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.socket.sendall(msgspec.json.encode(request) + b"\n")

    def answers(self) -> list[Started | Exited]:
        """All answers received so far."""
        with contextlib.suppress(BlockingIOError, ConnectionResetError):
            while data := self.socket.recv(65536, socket.MSG_DONTWAIT):
                self._rest += data
        *lines, self._rest = self._rest.split(b"\n")
        return [ANSWERS.decode(line) for line in lines]

    def read_printout(self) -> str:
        printout = b""
        while len(printout) < MOST_PRINTED and (data := self.output.read(65536)):
            printout += data
        return printout.decode(errors="replace")

    def close(self) -> str:
        """End the fork server and all workers. Returns their last output."""
        if self.output.closed:
            return ""
        self.socket.close()
        self.process.terminate()  # during imports it would notice the closed socket only later
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        last = self.read_printout()
        self.output.close()
        return last


def _serve(end: socket.socket, workers: dict[int, str]) -> None:
    """Answer requests until the launcher ends. `workers`: groups by process id."""
    wake, wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    signal.set_wakeup_fd(wake_write)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    rest = b""
    while True:
        ready = select.select([end.fileno(), wake], [], [])[0]
        if wake in ready:
            os.read(wake, 4096)
            _reap(end, workers)
        if end.fileno() in ready:
            data = end.recv(1 << 20)
            if not data:
                return
            rest += data
            *lines, rest = rest.split(b"\n")
            for line in lines:
                _do(end, REQUESTS.decode(line), workers)


def _end_all(workers: dict[int, str]) -> NoReturn:
    """Kill the process groups of the workers, and exit."""
    for pid in workers:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
    os._exit(0)


def _do(end: socket.socket, request: Prepare | Start | Kill, workers: dict[int, str]) -> None:
    match request:
        case Prepare(modules):
            for name in modules:
                with contextlib.suppress(Exception):  # the worker meets the same error and reports it
                    importlib.import_module(name)
            gc.collect()
            gc.freeze()  # otherwise garbage collection in the workers would write to shared pages and copy them
        case Start(job):
            pid = os.fork()
            if pid == 0:
                _work(end, request)
            workers[pid] = job.group
            end.sendall(msgspec.json.encode(Started(job.group, pid)) + b"\n")
        case Kill(group, number):
            for pid in [pid for pid, name in workers.items() if name == group]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, number)


def _work(end: socket.socket, request: Start) -> NoReturn:
    code = 1
    try:
        die_with_parent()
        set_title(f"palpate: {request.job.group}")
        os.setpgid(0, 0)
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGCHLD, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        end.close()
        from palpate.launch.run.work.process import serve

        code = REPORTED if with_room(serve, request) else 0
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _reap(end: socket.socket, workers: dict[int, str]) -> None:
    with contextlib.suppress(ChildProcessError):  # no child is left
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            pid, status = ended
            group = workers.pop(pid, None)
            if group is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(pid, signal.SIGKILL)
                end.sendall(msgspec.json.encode(Exited(group, os.waitstatus_to_exitcode(status))) + b"\n")


def _use_ordinary_priority() -> None:
    """Drop a real-time priority of the launcher (`chrt`); workers set theirs.

    Otherwise this process may spin in the kernel forever: it waits for the last thread of a dead worker, which has the
    lowest real-time priority (`engine.clock`) and so does not run on the same core.
    """
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def load() -> None:
    """Import the modules of the workers once, in parallel with the launcher's loading of the graph."""
    import palpate.nodes
    from palpate.registry import collection_suspended, modules

    with collection_suspended():
        modules(palpate.nodes)
        _load_worker()


def _load_worker() -> None:
    """Import numba and its implementations if a node has a kernel."""
    if "palpate.compiler.kernel" in sys.modules:
        from palpate.compiler.target.dispatcher import prepare

        prepare()  # takes 0.5 s, otherwise at the first kernel of each worker


def main(descriptor: int, load: Callable[[], None] = load) -> NoReturn:
    """Serve the launcher at the other end of this socket, when `load` has imported what workers need."""
    workers: dict[int, str] = {}
    signal.signal(signal.SIGTERM, lambda *_: _end_all(workers))
    die_with_parent(signal.SIGTERM)
    _use_ordinary_priority()
    gc.set_threshold(*COLLECTION)
    with_room(load)
    _serve(socket.socket(fileno=descriptor), workers)
    _end_all(workers)


if __name__ == "__main__":
    main(int(sys.argv[1]))
