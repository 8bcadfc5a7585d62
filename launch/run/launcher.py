"""The launcher: starts the workers of a run, holds the start barrier, watches, and ends them all.

Start: every worker builds its nodes, binds its outlets and reports ready; the launcher tells each whom to read; every
outlet waits until it has seen its readers; then all get the time of tick 0. No sleeps, no lost first message.
"""

from __future__ import annotations

import math
import os
import select
import signal
import time
import uuid
from collections.abc import Callable, Sequence

import msgspec
import zmq

from palpate.engine.clock import Silence, now
from palpate.engine.job import Job, members
from palpate.launch.run import reports
from palpate.launch.run.barrier import Barrier
from palpate.launch.run.ending import Ending
from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.interrupts import STOPPING, interrupts
from palpate.launch.run.member import WorkerHandle, lost
from palpate.launch.run.result import Death, Result
from palpate.launch.run.wire.keys import Key
from palpate.launch.run.wire.wires import ControlChannel, blocked_by
from palpate.launch.run.work.watchdog import START_PATIENCE
from palpate.launch.run.work.worker import REPORT

HEAD_START = 40_000_000  # [ns] from the order to go to tick 0: every worker has heard it by then
BEAT = 0.5  # [s] between signs of life for workers on other machines
GRACE = 0.1  # [s] that the others go on after a node died on the real clock: the device gets its zero force
LAST_WORDS = 5.0  # [s] that the report of an orderly end may take
MOST_REPORTS = 1000  # taken in a row, so that the launcher comes to the rest
LIMITS = {"starting": START_PATIENCE, "ready": math.inf, "linked": math.inf}
"""[s] for which a worker may be silent in these states: two of them wait for the others, and have nothing to say."""


def silent(text: str) -> None:
    """What prints where there is no live view: nothing."""


class Launcher:
    """Runs the jobs, each in a process.

    jobs        one per worker; those in `joined` are started by hand on another machine (`palpate remote join`)
    forkserver  the fork server; made here when not given
    address     where workers on other machines find this launcher: `tcp://host:port`, reports at port + 1
    key         secures what goes over TCP; None: nothing does
    patience    [s] without a sign of life after which a worker counts as hung
    restart     nodes that are started again when they die; spared: nodes that a run on the real clock goes on without
    show        called about ten times a second with the launcher, to draw
    printed     called with what the nodes print, and with their notes
    died        called at once when a node has failed in a run that goes on; a run that never began has it in its result
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        forkserver: ForkServer | None = None,
        *,
        joined: frozenset[str] = frozenset(),
        address: str | None = None,
        key: Key | None = None,
        patience: float = 5.0,
        restart: frozenset[str] = frozenset(),
        spared: frozenset[str] = frozenset(),
        show: Callable[[Launcher], None] = lambda _: None,
        printed: Callable[[str], None] = silent,
        died: Callable[[Death], None] = lambda _: None,
    ) -> None:
        self.begun = time.monotonic()
        self.jobs = {job.group: job for job in jobs}
        self.members = {job.group: WorkerHandle(job, joined=job.group in joined) for job in jobs}
        self.forkserver = forkserver or ForkServer()
        self.address, self.key, self.patience, self.restart, self.spared = address, key, patience, restart, spared
        self.show, self.printed, self.died = show, printed, died
        self.run_id = f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self.result = Result()
        self.origin = 0  # [ns] of the machine's monotonic clock at tick 0, once the run has begun
        self.phase = "starting"
        self._real = any(job.clock == "real" for job in jobs)
        self._interrupts: list[int] = []
        self._heeded = 0
        self._started: float | None = None
        self._ended = 0.0
        self._tail: list[str] = []
        self._beat = 0.0
        self._abreast = False  # whether all reports that have come were taken
        try:
            self._control = ControlChannel(self.run_id, self.jobs, address, key)
        except OSError:
            self.forkserver.close()
            raise
        self._barrier = Barrier(self.members, self._control)
        self._ending = Ending(self.members, self._control, self.forkserver, self._real, self.result.notes.append)
        for group in joined:
            self._control.expect(group)
            self.members[group].busy = f"{group} (palpate remote join {address} {group})"
        self._poller = zmq.Poller()
        self._control.register(self._poller)
        self._poller.register(self.forkserver.socket.fileno(), select.POLLIN)
        self._poller.register(self.forkserver.output.fileno(), select.POLLIN)

    @property
    def pids(self) -> dict[str, int]:
        """The processes of the workers here, by group."""
        return {group: member.pid for group, member in self.members.items() if member.pid is not None}

    @property
    def busy(self) -> dict[str, str]:
        """What each worker is doing while it starts, by group."""
        return {group: member.busy for group, member in self.members.items() if member.busy}

    @property
    def kernels(self) -> int:
        """How many kernels the workers have compiled so far: none but in the first run."""
        return sum(member.kernels for member in self.members.values())

    @property
    def foreign(self) -> int:
        """How many frames were dropped so far because they are none of this run's."""
        return self._control.foreign + sum(member.foreign for member in self.members.values())

    # -- the whole run -------------------------------------------------------------------------------------------

    def run(self) -> Result:
        """Start everything, wait for the end, end everything; Ctrl-C or SIGTERM stops the run in order. Returns what
        happened."""
        with interrupts(self._interrupts.append):
            self._run()
        if self._started is not None:
            self.result.wall = self._ended - self._started
        self.result.ticks = max((h["tick"] + 1 for h in self.result.health.values()), default=0)
        return self.result

    def stop(self) -> None:
        """End the run in order, as Ctrl-C does; for those who are called with the launcher."""
        if not self._interrupts:
            self._interrupts.append(signal.SIGINT)

    def _run(self) -> None:
        try:
            modules = {given.cls.rpartition(".")[0] for job in self.jobs.values() for given in members(job)}
            self.forkserver.ask(reports.Prepare(sorted(modules)))
            for member in self.members.values():
                if not member.joined:
                    self._fork(member)
            while any(member.state != "gone" for member in self.members.values()):
                self._turn()
        finally:
            self.phase = "ended"
            self.printed(self.forkserver.close())
            self.result.foreign = self.foreign
            if self.foreign:
                self.result.notes.append(f"{self.foreign} frames that are none of this run's were dropped")
            self._control.close(200)

    def _fork(self, member: WorkerHandle) -> None:
        self._control.expect(member.job.group)
        member.forked()
        control = self._control
        self.forkserver.ask(
            reports.Start(member.job, self.run_id, control.control, control.reports, self.key, control.guarded)
        )

    def _turn(self) -> None:
        ready = dict(self._poller.poll(100))
        for member, report in self._barrier.early():
            self._ready(member, report)
        self._abreast = False
        for _ in range(MOST_REPORTS):
            if not self._next_report():
                self._abreast = True
                break
        if self.forkserver.output.fileno() in ready:
            self._listen()
        if self.forkserver.socket.fileno() in ready:
            for answer in self.forkserver.answers():
                self._answer(answer)
            if self.forkserver.process.poll() is not None:
                self.result.deaths.append(Death("all", "process", "the fork server ended", "\n".join(self._tail)))
                for member in self.members.values():
                    member.state = "gone"
        if len(self._interrupts) > self._heeded:
            self._interrupt()
        self._check_time()
        self.show(self)

    def _listen(self) -> None:
        text = self.forkserver.printed()
        if text:
            self._tail = (self._tail + text.splitlines())[-40:]
            self.printed(text)

    # -- reports -------------------------------------------------------------------------------------------------

    def _next_report(self, wait: int = 0) -> bool:
        """Take what comes next to where workers report, if anything does within so many milliseconds."""
        if not self._control.reported(wait):
            return False
        addressed = self._control.report()
        if addressed is not None:
            self._take(self.members[addressed.group], addressed.report)
        return True

    def _take(self, member: WorkerHandle, report: reports.Report) -> None:
        if member.state == "gone" and not isinstance(report, reports.Alive):
            return  # overtaken by the end of its process, which says the same
        if not self._ending.closed or not isinstance(report, reports.Alive) or self._progress(report):
            member.heard()
        match report:
            case reports.Hello():
                self._control.tell(f"join-{member.job.group}", reports.Take(member.job, self.run_id))
            case reports.Starting(node, kernels):
                member.busy, member.kernels = node, kernels
            case reports.Ready():
                self._ready(member, report)
            case reports.Linked():
                self._linked(member)
            case reports.Alive(nodes, foreign, awaits):
                self.result.health.update(msgspec.to_builtins(nodes))
                member.foreign = foreign
                member.waits(awaits)
            case reports.Paused(tick):
                member.paused = tick
                ticks = [lead.paused for lead in self._leads()]
                if None not in ticks:
                    self._control.tell("*", reports.End(max(tick for tick in ticks if tick is not None)))
            case reports.NodeFault():
                self._died(member, report)
            case reports.Note(text):
                self.result.notes.append(text)
                if self.printed is not silent:
                    self.result.live.add(text)
                self.printed(text + "\n")
            case reports.NodesEnded(clean_exit):
                member.flushed, member.clean_exit = True, clean_exit
                if member.alive:
                    member.state = "done"
                    self._ending.follow()
                if member.joined:  # no process here shows its end: its last report does
                    self._is_gone(member)

    def _progress(self, report: reports.Alive) -> bool:
        """Whether observers, to whom nobody sends any more, still take what was sent."""
        return any(
            self.result.health.get(name, {}).get("steps") != counters.steps for name, counters in report.nodes.items()
        )

    def _ready(self, member: WorkerHandle, report: reports.Ready) -> None:
        if not member.alive or not self._barrier.ready(member, report):
            return
        if self._ending.over or (self._real and not any(lead.alive for lead in self._leads())):
            self._control.tell(member.job.group, reports.Stop())  # it did not hear that the run has ended meanwhile
            return
        self.result.notes += [n for n in report.refused if n not in self.result.notes]
        if self.phase == "running":
            self._barrier.link(member)
        elif self._barrier.all("ready"):
            self.phase = "linking"
            for each in self.members.values():
                self._barrier.link(each)

    def _linked(self, member: WorkerHandle) -> None:
        if not member.alive:
            return  # it was killed meanwhile
        member.state = "linked"
        if self.phase == "linking" and self._barrier.all("linked") and not self._ending.over:
            self._go()
        elif self.phase == "running":  # it was started again, and joins the run
            self._control.tell(member.job.group, reports.Go(self.origin))
            member.state = "running"
            self._tell_gone({node.name for node in member.job.nodes}, back=True)

    def _go(self) -> None:
        self.phase = "running"
        self._started = time.monotonic()
        self.result.start = self._started - self.begun
        self.result.origin = self._started
        self.origin = now() + (HEAD_START if self._real else 0)
        self._control.tell("*", reports.Go(self.origin))
        for member in self.members.values():
            member.state = "running"
            member.heard()

    # -- trouble -------------------------------------------------------------------------------------------------

    def _died(self, member: WorkerHandle, fault: reports.NodeFault) -> None:
        member.state = "failed"
        death = Death(fault.node or member.names, fault.where, fault.text, fault.trace)
        self.result.deaths.append(death)
        self._handle_death(member)
        if self.phase == "running":
            self.died(death)

    def _handle_death(self, member: WorkerHandle) -> None:
        """Tell the others, so that their inputs from this group become None; then end the run, start it again, or go on
        without it."""
        dead = {node.name for node in member.job.nodes}
        self._tell_gone(dead)
        goes_on = self._real and self.phase == "running" and dead and not self._ending.near
        if goes_on and dead <= self.restart:
            member.state = "restarting"
        elif goes_on and dead <= self.spared:
            self.result.notes.append(f"{', '.join(sorted(dead))} failed; the run went on without")
        elif dead or self.phase != "running":
            self._end_after(GRACE if self.phase == "running" and self._real else 0.0)

    def _end_after(self, seconds: float) -> None:
        if not self._ending.near and self.phase == "running":
            self.phase = "ending"
        self._ending.quit_after(seconds)

    def _tell_gone(self, nodes: set[str], back: bool = False) -> None:
        blocked = blocked_by(self.jobs.values(), nodes)
        self._control.tell("*", reports.Gone(tuple(sorted(nodes)), tuple(sorted(blocked)), back))

    def _answer(self, answer: reports.Started | reports.Exited) -> None:
        member = self.members[answer.group]
        if isinstance(answer, reports.Started):
            member.pid = answer.pid
            return
        # Its last words were sent before its end, but may come after the news of it; on a busy machine long after, and
        # one that ended well has sent them.
        silence = Silence()
        limit = LAST_WORDS if answer.status == 0 else 0.5 if answer.status > 0 else 0.002
        while member.alive and silence.look() < limit * 1e9:
            self._next_report(1)
        if member.alive:
            status = answer.status
            how = f"killed by {signal.Signals(-status).name}" if status < 0 else f"exit code {status}"
            self._listen()
            trace = "\n".join(self._tail) if status != -signal.SIGKILL else ""
            self._died(member, reports.NodeFault("", "process", f"its process ended: {how}", trace))
        member.pid = None
        if member.state == "restarting":
            self._fork(member)
        else:
            self._is_gone(member)

    def _is_gone(self, member: WorkerHandle) -> None:
        member.state = "gone"
        self._ended = time.monotonic()
        self._ending.follow()

    def _leads(self) -> list[WorkerHandle]:
        return [member for member in self.members.values() if member.job.leads]

    def _interrupt(self) -> None:
        """The first Ctrl-C stops the run in order, a second one at once."""
        self._heeded = len(self._interrupts)
        if self.result.interrupted:
            self._ending.kill()
            return
        self.result.signal = self._interrupts[0]
        self.printed(STOPPING)
        if self.phase in ("starting", "linking"):
            self._end_after(0.0)
        else:
            self.phase = "ending"
            self._ending.stop()

    def _check_time(self) -> None:
        moment = time.monotonic()
        if self.address and moment - self._beat > BEAT:
            self._beat = moment
            self._control.tell("*", reports.Beat())
        self._ending.check(begun=self.phase not in ("starting", "linking"))
        if not self._ending.near:
            self._check_hung()
            self._check_lost()

    def _check_lost(self) -> None:
        """A message that was lost ends the run as its sender's failure."""
        if self._real or self.phase != "running" or not self._abreast:
            return
        gone = lost(self.members.values(), self.result.health, math.ceil(1e9 * self.patience / REPORT))
        if gone is not None:
            self._died(gone[0], reports.NodeFault("", "stream", gone[1]))

    def _check_hung(self) -> None:
        """A worker that is silent for too long."""
        for group, member in self.members.items():
            if not member.alive or (member.state == "starting" and member.joined):
                continue
            limit = LIMITS.get(member.state, self.patience)
            if member.silence() <= limit:
                continue
            self.forkserver.ask(reports.Kill(group, int(signal.SIGUSR1)))  # prints where it hangs
            before, until = len(self._tail), time.monotonic() + 0.5
            while len(self._tail) == before and time.monotonic() < until:
                time.sleep(0.05)
                self._listen()
            where = "step" if member.state == "running" else "start"
            nodes = member.busy or ", ".join(node.name for node in member.job.nodes) or member.names
            text = f"no sign of life for {limit:.3g} s: it hangs, or was stopped"
            self._died(member, reports.NodeFault(nodes, where, text, "\n".join(self._tail[-20:])))
            self.forkserver.ask(reports.Kill(group, int(signal.SIGKILL)))
            if member.joined:
                self._is_gone(member)
