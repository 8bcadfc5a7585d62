"""Workers that are started one by one, on systems without `fork` or Unix sockets.

Each runs `python -m palpate.launch.run.work.spawner`, receives its `Start` as a line of JSON on its standard input,
which includes the key of the run, and ends when this input closes, as when the launcher ends.
"""

import contextlib
import os
import queue
import subprocess
import sys
import threading
from typing import IO, Any, NoReturn

import msgspec
import zmq

from palpate.compiler.arithmetic import environment
from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.reports import KILL, REPORTED, Exited, Kill, Prepare, Start, Started
from palpate.launch.run.wire.addresses import has_unix_sockets
from palpate.launch.run.work.activity import activity


class Spawner:
    """Starts and ends workers, with the methods of `ForkServer`."""

    alive = True
    look = staticmethod(activity)
    pid: int | None = None  # each worker is started at once, and then known by its number

    def __init__(self) -> None:
        self._workers: dict[str, subprocess.Popen[bytes]] = {}
        self._started: list[Started | Exited] = []
        self._printed: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._readers: list[threading.Thread] = []

    def register(self, poller: zmq.Poller) -> None:
        """Nothing wakes the poller: what a worker prints, and its end, are noticed at the launcher's next turn."""

    def ask(self, request: Prepare | Start | Kill) -> None:
        """Start or kill a worker. Without `fork` there is nothing to prepare, and no signal asks a silent worker."""
        match request:
            case Start(job):
                self._start(job.group, msgspec.json.encode(request) + b"\n")
            case Kill(group, number) if number == KILL and group in self._workers:
                self._workers[group].kill()

    def _start(self, group: str, request: bytes) -> None:
        worker = subprocess.Popen(
            [sys.executable, "-m", "palpate.launch.run.work.spawner"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={
                **environment(),
                "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                "PYTHONUNBUFFERED": "1",
            },
            # Ctrl-C reaches only the launcher, which shuts the workers down
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
        assert worker.stdin is not None and worker.stdout is not None
        reader = threading.Thread(target=self._read, args=(worker.stdout,), daemon=True, name=f"output of {group}")
        reader.start()
        self._readers.append(reader)
        with contextlib.suppress(OSError):  # it has ended, which `answers` reports
            worker.stdin.write(request)
            worker.stdin.flush()
        self._workers[group] = worker
        self._started.append(Started(group, worker.pid))

    def _read(self, output: IO[bytes]) -> None:
        for line in output:
            self._printed.put(line)

    def answers(self) -> list[Started | Exited]:
        """What has happened since the last call."""
        found, self._started = self._started, []
        for group, worker in list(self._workers.items()):
            if worker.poll() is not None:
                found.append(Exited(group, worker.returncode))
                _close(self._workers.pop(group))
        return found

    def read_printout(self) -> str:
        """What the workers have printed since the last call."""
        lines = []
        with contextlib.suppress(queue.Empty):
            while True:
                lines.append(self._printed.get_nowait())
        return b"".join(lines).decode(errors="replace")

    def close(self) -> str:
        """End all workers. Returns their last output."""
        for worker in self._workers.values():
            worker.kill()
            worker.wait()
            _close(worker)
        self._workers.clear()
        for reader in self._readers:
            reader.join(1.0)
        return self.read_printout()


def _close(worker: subprocess.Popen[Any]) -> None:
    if worker.stdin is not None:
        with contextlib.suppress(OSError):
            worker.stdin.close()


def worker_server(forked: bool = False) -> ForkServer | Spawner:
    """What starts the workers of a run on this system; `forked`: see `ForkServer`."""
    return ForkServer(forked) if has_unix_sockets() else Spawner()


def _end_with_launcher() -> NoReturn:
    """Exit when the launcher has closed the standard input of this process."""
    with contextlib.suppress(OSError):
        os.read(sys.stdin.fileno(), 1)
    os._exit(1)


def main() -> NoReturn:
    """The worker's side."""
    start = msgspec.json.decode(sys.stdin.buffer.readline(), type=Start)
    threading.Thread(target=_end_with_launcher, daemon=True).start()
    code = 1
    try:
        from palpate.launch.run.work.process import serve

        code = REPORTED if serve(start) else 0
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    main()
