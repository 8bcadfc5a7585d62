"""The simulated machines: the fork server with the workers here, and workers that join from elsewhere.

Workers run the product's `work`, `Worker` and loops. Simulated are the fork server, `palpate remote join` before its
job arrives, and the second process there that reports what the first one does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import msgspec
from msgspec.structs import replace

from palpate.engine.job import Job
from palpate.launch.run import reports
from palpate.launch.run.reports import REPORTED, Addressed, Exited, Hello, Kill, Prepare, Pulse, Start, Started
from palpate.launch.run.wire.bus import split
from palpate.launch.run.work.activity import ENDED, Activity
from palpate.launch.run.work.process import LAST_PULSE, PULSE, work
from palpate.studies.faults.launcher.control import Line, Sockets
from palpate.studies.faults.launcher.process import Process
from palpate.studies.faults.launcher.readings import Net
from palpate.studies.faults.launcher.wire import Wire
from palpate.studies.faults.launcher.world import KILLED, MS, SECOND, World

HELLO = 250 * MS  # [ns] between two requests for a job
MONTH = 30 * 86_400 * SECOND  # [ns]
DRIFT = 1e-4  # [1] of the rate of a clock, 50 ppm for each of two
IMPORTS = 0.3  # [s] of the fork server, at most


def grant(core: object, priority: object) -> list[str]:
    """Privileges of a simulated process: none are refused."""
    return []


class SimulatedForkServer:
    """The fork server, see `ForkServer`: it handles one request at a time.

    begun  called with each new worker: group and process
    """

    def __init__(self, world: World, net: Net, launcher: Process) -> None:
        self.world, self._net, self._launcher = world, net, launcher
        self.sockets: Sockets | None = None
        self.process = Process(world, "fork server", self._sleep)
        world.start(self.process)
        self.workers: dict[Process, str] = {}
        self._wires: dict[Process, Wire] = {}
        self.begun: Callable[[str, Process], None] = lambda group, process: None
        self._random = world.random_of("requests")
        self._free = self._answered = 0  # when the last request is done, when its answer arrives [ns]
        self._printed = ""
        self.process.on_end.append(self._end)

    def _sleep(self) -> int:
        self.world.wait(None)
        return 0

    @property
    def alive(self) -> bool:
        return self.process.alive

    @property
    def pid(self) -> int:
        return self.process.pid

    def look(self, pid: int) -> Activity | None:
        """What a process does."""
        return next((p.activity() for p in self.world.processes if p.pid == pid), Activity(ENDED))

    def register(self, poller: object) -> None:
        """Answers wake the launcher."""

    def ask(self, request: Prepare | Start | Kill) -> None:
        self.world.check()
        spent = int(self._random.random() * IMPORTS * SECOND) if isinstance(request, Prepare) else MS
        self._free = max(self._free, self.world.time) + self.world.delay(self._random) + spent
        self.world.at(self._free, lambda: self._do(request))

    def _do(self, request: Prepare | Start | Kill) -> None:
        if not self.process.alive:
            return
        match request:
            case Start(job, run):
                worker = Process(self.world, f"{job.group} {len(self.workers)}", lambda: self._work(worker, job, run))
                self.workers[worker] = job.group
                worker.on_end.append(
                    lambda: self.world.after(self.world.delay(self._random), lambda: self._reap(worker))
                )
                self.world.start(worker, self.world.delay(self._random))
                self._reply(Started(job.group, worker.pid))
                self.begun(job.group, worker)
            case Kill(group, number):
                for worker in [each for each, name in self.workers.items() if name == group and each.alive]:
                    if number == reports.KILL:
                        self.world.kill(worker)
                    elif not worker.stopped and worker.call:
                        self._printed += f"traceback of {worker.name}\n"
                        self._wires[worker].line.report(
                            msgspec.msgpack.encode(Addressed(group, reports.InCall(worker.call)))
                        )

    def _work(self, process: Process, job: Job, run: str) -> int:
        assert self.sockets is not None
        wire = Wire(self._net, self.sockets, process, run, job, alone=False)
        self._wires[process] = wire
        return REPORTED if work(job, wire, False, grant) else 0  # type: ignore[arg-type]

    def _reap(self, worker: Process) -> None:
        if self.process.alive:
            self._reply(Exited(self.workers[worker], worker.status if worker.status is not None else KILLED))

    def _reply(self, answer: Started | Exited) -> None:
        self._answered = max(self._answered, self.world.time + self.world.delay(self._random))

        def arrive() -> None:
            assert self.sockets is not None
            self.sockets.answers.append(answer)
            self.world.poke(self._launcher)

        self.world.at(self._answered, arrive)

    def answers(self) -> list[Started | Exited]:
        assert self.sockets is not None
        self.world.check()
        found = list(self.sockets.answers)
        self.sockets.answers.clear()
        return found

    def read_printout(self) -> str:
        printed, self._printed = self._printed, ""
        return printed

    def _end(self) -> None:
        """The kernel ends the workers with the fork server, and its socket wakes the launcher."""
        for worker in self.workers:
            self.world.kill(worker)
        if self.sockets is not None:
            self.sockets.closed = True
            self.world.poke(self._launcher)

    def close(self) -> str:
        self.world.check()
        self.world.kill(self.process)
        return ""


class Far:
    """A machine on which `palpate remote join` runs.

    worker, helper  its processes
    """

    def __init__(self, world: World, net: Net, sockets: Sockets, group: str, delay: int, patience: int) -> None:
        self.world, self._net, self._sockets, self.group, self._patience = world, net, sockets, group, patience
        self.worker = Process(world, f"{group} joined", self._join)
        random_ = world.random_of(f"clock of {group}")
        self.worker.ahead = random_.choice([0, -SECOND // 2, random_.randint(0, MONTH)])
        self.worker.fast = random_.uniform(-DRIFT, DRIFT)
        self.helper: Process | None = None
        self.lines: list[Line] = []
        self.taken = False  # whether it has its job
        world.start(self.worker, delay)

    def _join(self) -> int:
        taken: deque[bytes] = deque()
        line = Line(self._sockets, self.worker, f"join-{self.group}", taken.append)
        self.lines.append(line)
        until = self.world.time + self._patience
        while not taken:
            if self.world.time > until:
                return 2
            line.report(msgspec.msgpack.encode(Addressed(self.group, Hello())))
            self.world.wait(self.world.time + HELLO, lambda: bool(taken))
        take = msgspec.json.decode(split(taken[0])[1].partition(b" ")[2], type=reports.Take)
        line.close()
        self.taken = True
        self.helper = Process(self.world, f"{self.group} helper", self._pulse)
        self.world.start(self.helper, self.world.delay(self.worker.random))
        job = replace(take.job, host=take.job.host or "10.0.0.2")
        wire = Wire(self._net, self._sockets, self.worker, take.run, job, alone=True)
        self.lines.append(wire.line)
        try:
            return work(job, wire, True, grant)  # type: ignore[arg-type]
        finally:
            self.world.check()
            self.world.kill(self.helper)

    def _pulse(self) -> int:
        assert self.helper is not None
        line = Line(self._sockets, self.helper, f"pulse-{self.group}", lambda data: None)
        self.lines.append(line)
        found: Activity | None = None
        while found is None or found.state != ENDED:
            self.world.wait(self.world.time + int(PULSE * SECOND))
            found = self.worker.activity()
            if found.state == ENDED:
                self.world.wait(self.world.time + int(LAST_PULSE * SECOND))
            line.report(msgspec.msgpack.encode(Addressed(self.group, Pulse(found))))
        self.world.wait(self.world.time + SECOND)  # to send it
        return 0
