"""The launcher: starts the workers of a run, controls the start barrier, monitors the workers, and shuts them down.

Start: each worker builds its nodes, binds its outlets and reports ready; the launcher sends each the outlets to connect
to; each outlet waits for its readers; then all receive the time of tick 0. No sleeps, no lost first message.
"""

from __future__ import annotations

import math
import os
import signal
import uuid
from collections.abc import Callable, Sequence

import msgspec

from palpate.engine import clock
from palpate.engine.clock import Silence
from palpate.engine.job import Job, members
from palpate.launch.run import reports
from palpate.launch.run.ending import Ending
from palpate.launch.run.forkserver import ForkServer
from palpate.launch.run.interrupts import STOPPING, interrupts
from palpate.launch.run.member import Asked, WorkerHandle, find_loss
from palpate.launch.run.notes import RunNote
from palpate.launch.run.result import NodeFault, Result
from palpate.launch.run.wire.addresses import has_unix_sockets
from palpate.launch.run.wire.discover import Running
from palpate.launch.run.wire.keys import Key
from palpate.launch.run.wire.printable import lines_of, one_line, printable
from palpate.launch.run.wire.wires import (
    ControlChannel,
    ControlSockets,
    blocked_by,
    listeners,
    read_streams,
    wrong_endpoint,
)
from palpate.launch.run.work.activity import ENDED, Activity
from palpate.launch.run.work.heartbeat import REPORT
from palpate.launch.run.work.spawner import Spawner, worker_server

HEAD_START = 40_000_000  # [ns] from the order `Go` to tick 0, so that every worker has received it
BEAT = 0.5  # [s] between heartbeats to workers on other machines
GRACE = 0.1  # [s] from the death of a node on the real clock to the shutdown, so that the device gets zero force
ANSWER = 0.5  # [s] to wait for the traceback of a hung worker
LAST_REPORT = 5.0  # [s] to wait for the last report of a worker that has sent one
MOST_REPORTS = 1000  # handled in a row, so that a flood of reports does not block the launcher


def silent(text: str) -> None:
    """Prints nothing, for runs without a live view."""


class Launcher:
    """Runs each job in a process.

    jobs        one per worker; those in `joined` are started by hand on another machine (`palpate remote join`)
    forkserver  what starts the workers; None: make one
    sockets     makes the sockets to the workers: name of the run, `address`, `key`
    address     TCP address of this launcher for other machines: `tcp://host:port`, reports at port + 1
    key         encrypts TCP; None: no encryption
    patience    [s] without a heartbeat after which a worker counts as hung
    restart     nodes that are restarted when they die
    spared      nodes whose death does not end a run on the real clock
    show        called about ten times a second with the launcher, to draw
    printed     called with the output and the notes of the nodes
    died        called when a node fails after tick 0
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        forkserver: ForkServer | Spawner | None = None,
        *,
        sockets: Callable[[str, str | None, Key | None], ControlSockets] = ControlSockets,
        joined: frozenset[str] = frozenset(),
        address: str | None = None,
        key: Key | None = None,
        patience: float = 5.0,
        restart: frozenset[str] = frozenset(),
        spared: frozenset[str] = frozenset(),
        show: Callable[[Launcher], None] = lambda _: None,
        printed: Callable[[str], None] = silent,
        died: Callable[[NodeFault], None] = lambda _: None,
    ) -> None:
        self.begun = clock.seconds()
        self.jobs = {job.group: job for job in jobs}
        self.forkserver = forkserver or worker_server()
        self.members = {
            job.group: WorkerHandle(job, joined=job.group in joined, look=self.forkserver.look) for job in jobs
        }
        self._nodes = {name for member in self.members.values() for name in member.nodes}
        self.address, self.key, self.patience, self.restart, self.spared = address, key, patience, restart, spared
        self.show, self.printed, self.died = show, printed, died
        self.run_id = f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self.result = Result()
        self.origin = 0  # [ns] of the machine's monotonic clock at tick 0, once the run has begun
        self.phase = "starting"
        self._real = any(job.clock == "real" for job in jobs)
        self._interrupts: list[int] = []
        self._handled = 0  # interrupts
        self._started: float | None = None
        self._ended = 0.0
        self._tail: list[str] = []
        self._beat = 0.0
        self._caught_up = False  # whether all received reports were handled
        try:
            self._control = ControlChannel(sockets(self.run_id, address, key), self.jobs)
        except OSError:
            self.forkserver.close()
            raise
        self._ending = Ending(self.members, self._control, self.forkserver, self._real, self.result.notes.append)
        for group in joined:
            self._control.expect(group)
            self.members[group].busy = f"{group} (palpate remote join {address} {group})"
        self._control.sockets.wake_by(self.forkserver)

    @property
    def pids(self) -> dict[str, int]:
        """The processes of the workers here, by group."""
        return {group: member.pid for group, member in self.members.items() if member.pid is not None}

    @property
    def running(self) -> Running:
        """What readers in this process need to receive the streams."""
        senders = [member for member in self.members.values() if member.job.nodes]
        far = [member for member in senders if member.joined or not has_unix_sockets()]
        near = [member.job.group for member in senders if member not in far]
        return Running(self.run_id, near, [member.endpoints["observers"][-1] for member in far], self.key)

    @property
    def busy(self) -> dict[str, str]:
        """The node that each starting worker builds, by group."""
        return {group: member.busy for group, member in self.members.items() if member.busy}

    @property
    def kernels(self) -> int:
        """Number of kernels compiled so far; 0 except in the first run on a machine."""
        return sum(member.kernels for member in self.members.values())

    # -- the whole run -------------------------------------------------------------------------------------------

    def run(self) -> Result:
        """Run to the end. Ctrl-C or SIGTERM shuts the run down gracefully."""
        with interrupts(self._interrupts.append):
            self._run()
        if self._started is not None:
            self.result.wall = self._ended - self._started
        self.result.ticks = max((h["tick"] + 1 for h in self.result.health.values()), default=0)
        return self.result

    def stop(self) -> None:
        """Shut the run down gracefully, as Ctrl-C does; for the callbacks of the launcher."""
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
            if self._control.foreign:
                text = f"{self._control.foreign} frames that do not belong to this run were dropped"
                self.result.notes.append(text)
            self._control.sockets.close(200)

    def _fork(self, member: WorkerHandle) -> None:
        self._control.expect(member.job.group)
        member.reset_state()
        member.starter = self.forkserver.pid
        sockets = self._control.sockets
        self.forkserver.ask(
            reports.Start(member.job, self.run_id, sockets.control, sockets.reports, self.key, sockets.guarded)
        )

    def _turn(self) -> None:
        leaving = any(member.exited is not None for member in self.members.values())
        self._control.sockets.wait(1 if leaving else 100)
        self._control.deliver()
        self._caught_up = not all(self._next_report() for _ in range(MOST_REPORTS))
        self._listen()
        for answer in self.forkserver.answers():
            self._answer(answer)
        for member in self.members.values():
            self._end_process(member)
        if not self.forkserver.alive:
            self.result.deaths.append(NodeFault("all", "process", "the fork server ended", "\n".join(self._tail)))
            for member in self.members.values():
                member.state = "gone"
        if len(self._interrupts) > self._handled:
            self._interrupt()
        self._check_time()
        self.show(self)

    def _listen(self) -> None:
        text = self.forkserver.read_printout()
        if text:
            self._tail = (self._tail + text.splitlines())[-40:]
            self.printed(text)

    # -- reports -------------------------------------------------------------------------------------------------

    def _next_report(self, wait: int = 0) -> bool:
        """Handle the next report. False: none arrived within `wait` [ms]."""
        if not self._control.sockets.has_report(wait):
            return False
        addressed = self._control.report()
        if addressed is not None:
            self._take(self.members[addressed.group], addressed.report)
        return True

    def _take(self, member: WorkerHandle, report: reports.Report) -> None:
        if member.state == "gone" and not isinstance(report, reports.Alive):
            return  # the end of its process was handled before
        unchanged = self._ending.closed and isinstance(report, reports.Alive) and not self._progress(report)
        if unchanged:
            member.waited = clock.seconds()
        elif not isinstance(report, reports.Pulse):
            member.reset_silence()
        match report:
            case reports.Hello():
                if not member.taken:
                    member.taken, member.busy = True, ""
                from palpate.launch.run.tasks.task import sources  # no other run needs it

                take = reports.Take(member.job, self.run_id, sources())
                self._control.send_order(f"join-{member.job.group}", take)
            case reports.Pulse(found):
                self._take_pulse(member, found)
            case reports.Starting(node, kernels):
                member.busy, member.kernels = node if node in member.nodes else "", kernels
            case reports.Compiling(active):
                member.compiling = active
            case reports.InCall(node):
                member.busy = node if node in member.nodes else ""
            case reports.Ready():
                self._ready(member, report)
            case reports.Linked():
                self._link_worker(member)
            case reports.Alive(nodes, awaits):
                of_group = {name: counters for name, counters in nodes.items() if name in member.nodes}
                self.result.health.update(msgspec.to_builtins(of_group))
                member.waits(awaits)
            case reports.Paused(tick):
                member.paused = tick
                self._agree_on_the_end()
            case NodeFault(node, where, text, trace):
                text, trace = (lines_of(each) if member.joined else printable(each) for each in (text, trace))
                # a node may find the fault of another one, which sent it a message that is none
                fault = NodeFault(node if node in self._nodes else "", one_line(where), text, trace)
                self._report_death(member, fault)
            case reports.Note(text, node, time_):
                note = RunNote(one_line(text) if member.joined else text, node if node in self._nodes else "", time_)
                self.result.notes.append(note)
                if self.printed is not silent:
                    self.result.live.add(note.text)
                self.printed(note.text + "\n")
            case reports.Observes():
                member.observes = True
                self._note_last_tick(member)
                self._ending.follow()
            case reports.NodesEnded(clean_exit):
                member.flushed, member.clean_exit = True, clean_exit
                if clean_exit:
                    self._note_last_tick(member)
                if member.alive:
                    member.state = "done"
                    self._ending.follow()
                if member.joined:  # its process is on another machine, so the last report marks its end
                    self._is_gone(member)

    def _take_pulse(self, member: WorkerHandle, found: Activity) -> None:
        """Note what the process of a worker on another machine does; its end is a failure."""
        member.take_pulse(found)
        if found.state == ENDED and member.alive:
            self._report_death(member, NodeFault("", "process", "its process ended without a report"))
            self._is_gone(member)

    def _progress(self, report: reports.Alive) -> bool:
        """Whether observers still receive messages after the end of all nodes."""
        return any(
            self.result.health.get(name, {}).get("steps") != counters.steps for name, counters in report.nodes.items()
        )

    def _ready(self, member: WorkerHandle, report: reports.Ready) -> None:
        if not member.alive:
            return
        if wrong := wrong_endpoint(self.run_id, member.job.group, member.joined, report.endpoints):
            self._report_death(member, NodeFault("", "process", wrong))
            self.forkserver.ask(reports.Kill(member.job.group, reports.KILL))
            if member.joined:
                self._control.send_order(member.job.group, reports.Quit())
                self._is_gone(member)
            return
        member.endpoints, member.secured = report.endpoints, report.secured
        member.busy, member.state = "", "ready"
        if self._ending.over or (self._real and not any(lead.alive for lead in self._leads())):
            self._control.send_order(member.job.group, reports.Stop())  # it missed the end of the run
            return
        refused = map(one_line, report.refused)
        self.result.notes += [text for text in refused if text not in self.result.notes]
        if self.phase == "running":
            self._link(member)
        elif self._all("ready"):
            self.phase = "linking"
            for each in self.members.values():
                self._link(each)

    def _all(self, state: str) -> bool:
        return all(member.state == state for member in self.members.values())

    def _link(self, member: WorkerHandle) -> None:
        """Send a worker the outlets to connect to and the number of readers to wait for."""
        others = {group: job for group, job in self.jobs.items() if group != member.job.group}
        sources = []
        for group, outlet, streams in read_streams(member.job, others):
            other = self.members[group]
            if other.endpoints:
                # The local address if both are children of this process, else the TCP address.
                address = other.endpoints[outlet][-1 if member.joined or other.joined else 0]
                seen = outlet == "observers"
                sources.append(reports.OutletAddress(group, address, tuple(streams), seen, other.secured))
        alive = {group: job for group, job in others.items() if self.members[group].alive}
        observed = listeners(member.job, alive)
        self._control.send_order(
            member.job.group, reports.Connect(tuple(sources), observed, awaited=self.phase != "running")
        )

    def _link_worker(self, member: WorkerHandle) -> None:
        if not member.alive:
            return  # it has been killed
        member.state = "linked"
        if self.phase == "linking" and self._all("linked") and not self._ending.over:
            self._go()
        elif self.phase == "running":  # it was restarted
            self._control.send_order(member.job.group, reports.Go(self.origin, clock.now()))
            member.state = "running"
            self._send_gone({node.name for node in member.job.nodes}, back=True)

    def _go(self) -> None:
        self.phase = "running"
        self._started = clock.seconds()
        self.result.start = self._started - self.begun
        self.result.origin = self._started
        self.origin = clock.now() + (HEAD_START if self._real else 0)
        self._control.send_order("*", reports.Go(self.origin, clock.now()))
        for member in self.members.values():
            member.state = "running"
            member.reset_silence()

    # -- failures ------------------------------------------------------------------------------------------------

    def _report_death(self, member: WorkerHandle, fault: NodeFault) -> None:
        member.state = "failed"
        death = msgspec.structs.replace(fault, node=fault.node or member.names)
        self.result.deaths.append(death)
        self._handle_death(member)
        if self.phase == "running":
            self.died(death)

    def _handle_death(self, member: WorkerHandle) -> None:
        """Make the inputs from this group None at the others; then end the run, restart the group, or continue without
        it."""
        dead = {node.name for node in member.job.nodes}
        self._send_gone(dead)
        continues = self._real and self.phase == "running" and dead and not self._ending.near
        if continues and dead <= self.restart and not member.joined:
            member.state = "restarting"
        elif continues and dead <= self.spared:
            self.result.notes.append(f"{', '.join(sorted(dead))} failed; the run continued without")
        elif dead or self.phase in ("starting", "linking"):
            self._end_after(GRACE if self.phase == "running" and self._real else 0.0)

    def _end_after(self, seconds: float) -> None:
        if not self._ending.near and self.phase == "running":
            self.phase = "ending"
        self._ending.quit_after(seconds)

    def _send_gone(self, nodes: set[str], back: bool = False) -> None:
        blocked = blocked_by(self.jobs.values(), nodes)
        self._control.send_order("*", reports.Gone(tuple(sorted(nodes)), tuple(sorted(blocked)), back))

    def _answer(self, answer: reports.Started | reports.Exited) -> None:
        member = self.members[answer.group]
        if isinstance(answer, reports.Started):
            member.pid = answer.pid
            return
        member.exited, member.since = answer.status, Silence()

    def _end_process(self, member: WorkerHandle) -> None:
        """Handle the end of a worker's process, once its last report has arrived.

        This report was sent before the process ended, but it may arrive after the answer of the fork server, on a busy
        machine seconds later. A process with one of these exit codes has certainly sent it.
        """
        status = member.exited
        if status is None:
            return
        limit = LAST_REPORT if status in (0, reports.REPORTED) else 0.5 if status > 0 else 0.002
        if member.alive and member.since.poll() < limit * 1e9:
            return
        how = f"killed by {signal.Signals(-status).name}" if status < 0 else f"exit code {status}"
        trace = "\n".join(self._tail) if status != -reports.KILL else ""
        if member.alive:
            self._report_death(member, NodeFault("", "process", f"its process ended: {how}", trace))
        elif member.clean_exit and member.state == "done" and status != 0:
            self._lose_messages(member, f"its process ended before its last messages were delivered: {how}")
        member.pid = member.exited = None
        if member.state == "restarting":
            self._fork(member)
        else:
            self._is_gone(member)

    def _lose_messages(self, member: WorkerHandle, text: str) -> None:
        """A worker has ended after its nodes, and observers may lack its last messages."""
        member.clean_exit = False
        if not self._ending.near:
            self.result.deaths.append(NodeFault(member.names, "process", text))

    def _note_last_tick(self, member: WorkerHandle) -> None:
        """The nodes of a worker have made all their ticks, perhaps before it was asked where it may end."""
        if member.job.leads and member.paused is None and member.job.ticks is not None:
            member.paused = member.job.ticks - 1
            self._agree_on_the_end()

    def _agree_on_the_end(self) -> None:
        """On the simulated clock all workers end at the same tick: the largest at which a paced one waits or ended."""
        ticks = [lead.paused for lead in self._leads() if lead.paused is not None]
        if not self._real and len(ticks) == len(self._leads()) and any(lead.alive for lead in self._leads()):
            self._control.send_order("*", reports.End(max(ticks)))

    def _is_gone(self, member: WorkerHandle) -> None:
        member.state = "gone"
        self._ended = clock.seconds()
        self._ending.follow()

    def _leads(self) -> list[WorkerHandle]:
        return [member for member in self.members.values() if member.job.leads]

    def _interrupt(self) -> None:
        """The first Ctrl-C starts a graceful shutdown, the second one kills the workers."""
        self._handled = len(self._interrupts)
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
        moment = clock.seconds()
        if self.address and moment - self._beat > BEAT:
            self._beat = moment
            for group, member in self.members.items():
                if member.state != "starting" or member.taken:
                    self._control.send_order(group, reports.Beat(self._control.received[group], clock.now()))
        self._ending.check(begun=self.phase not in ("starting", "linking"))
        if not self._ending.near:
            self._check_hung()
        self._check_lost()

    def _check_lost(self) -> None:
        """A lost message on the simulated clock ends the run as a failure of its sender, also after Ctrl-C, when its
        reader would wait for it."""
        if self._real or self.phase not in ("running", "ending") or not self._caught_up:
            return
        gone = find_loss(self.members.values(), self.result.health, math.ceil(1e9 * self.patience / REPORT))
        if gone is not None and gone[0].alive:
            self._report_death(gone[0], NodeFault("", "stream", gone[1]))

    def _check_hung(self) -> None:
        """Kill workers that are silent for too long."""
        for group, member in self.members.items():
            if member.joined and member.state == "starting" and not member.taken:
                continue  # it has yet to be started by hand
            if member.state == "done" and (text := member.hang(self.patience)):
                if member.clean_exit:
                    self._lose_messages(member, f"{text} before its last messages were delivered")
                member.reset_silence()
                self.forkserver.ask(reports.Kill(group, reports.KILL))
                continue
            if member.state == "restarting" and member.hang(self.patience):  # its successor waits for its end
                member.reset_silence()
                self.forkserver.ask(reports.Kill(group, reports.KILL))
                continue
            if not member.alive:
                continue
            if member.asked is None:
                if text := member.hang(self.patience):
                    if self._ending.forsake(member):
                        continue
                    self.forkserver.ask(reports.Kill(group, reports.ASK))  # prints its traceback, reports its node
                    member.asked = Asked(text, len(self._tail), Silence())
                continue
            text, lines, since = member.asked
            if (len(self._tail) == lines or not member.busy) and since.poll() < ANSWER * 1e9:
                continue
            where = "step" if member.state == "running" else "start"
            nodes = member.busy or ", ".join(node.name for node in member.job.nodes) or member.names
            self._report_death(member, NodeFault(nodes, where, text, "\n".join(self._tail[-20:])))
            self.forkserver.ask(reports.Kill(group, reports.KILL))
            if member.joined:
                self._ending.unreachable = True
                if not self._real:  # the others wait until it has received their messages
                    self._end_after(0.0)
                self._is_gone(member)
