"""The launcher: starts the workers of a run, holds the start barrier, watches, and ends them all.

Start: every worker builds its nodes, binds its outlets and reports ready; the launcher tells each whom to read; every
outlet waits until it has seen its readers; then all get the time of tick 0. No sleeps, no lost first message.
"""

from __future__ import annotations

import os
import select
import signal
import time
import uuid
from collections.abc import Callable, Sequence

import msgspec
import zmq

from palpate.launch.running.clock import now
from palpate.launch.running.interrupts import interrupts
from palpate.launch.running.job import Job, members
from palpate.launch.running.links import heard, inboxes, listeners, muted
from palpate.launch.running.nursery import Nursery
from palpate.launch.running.result import Death, Result
from palpate.launch.running.watchdog import START_PATIENCE
from palpate.launch.running.wires import Wires

STOP_PATIENCE = 3.0  # [s] for the workers to end once they were told
HEAD_START = 40_000_000  # [ns] from the order to go to tick 0: every worker has heard it by then
ALIVE = ("starting", "ready", "linked", "running")
BEAT = 0.5  # [s] between signs of life for workers on other machines
GRACE = 0.1  # [s] that the others go on after a node died on the real clock: the device gets its zero force


class Launcher:
    """Runs the jobs, each in a process.

    jobs      one per worker; those in `joined` are started by hand on another machine (`palpate join`)
    nursery   the fork server; made here when not given
    address   where workers on other machines find this launcher: `tcp://host:port`, reports at port + 1
    patience  [s] without a sign of life after which a worker counts as hung
    show      called about ten times a second with the launcher, to draw
    printed   called with what the nodes print
    died      called at once when a node has failed in a run that goes on; a run that never began has it in its result
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        nursery: Nursery | None = None,
        *,
        joined: frozenset[str] = frozenset(),
        address: str | None = None,
        patience: float = 5.0,
        restart: frozenset[str] = frozenset(),
        show: Callable[[Launcher], None] = lambda _: None,
        printed: Callable[[str], None] = lambda _: None,
        died: Callable[[Death], None] = lambda _: None,
    ) -> None:
        self.begun = time.monotonic()
        self.jobs = {job.group: job for job in jobs}
        self.nursery = nursery or Nursery()
        self.joined, self.address, self.patience, self.restart = joined, address, patience, restart
        self.show, self.printed, self.died = show, printed, died
        self.run_id = f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
        self.result = Result()
        self.origin = 0
        """[ns] of the machine's monotonic clock at tick 0, once the run has begun."""
        self.phase = "starting"
        self.busy: dict[str, str] = {}
        """What each worker is doing while it starts, by group."""
        self.pids: dict[str, int] = {}
        self._state: dict[str, str] = dict.fromkeys(self.jobs, "starting")
        self._endpoints: dict[str, dict[str, list[str]]] = {}
        self._seen = dict.fromkeys(self.jobs, time.monotonic())
        self._early: dict[str, dict] = {}
        self._paused: dict[str, int] = {}
        self._interrupts = self._heeded = 0
        self._deadline: float | None = None
        self._tail: list[str] = []
        self._beat = 0.0
        try:
            self._wires = Wires(self.run_id, self.jobs, address)
        except OSError:
            self.nursery.close()
            raise
        for group in joined:
            self._wires.expect(group)
        self._poller = zmq.Poller()
        self._wires.register(self._poller)
        self._poller.register(self.nursery.socket.fileno(), select.POLLIN)
        self._poller.register(self.nursery.output.fileno(), select.POLLIN)
        self.busy.update({group: f"{group} (palpate join {address} {group})" for group in joined})

    # -- the whole run -------------------------------------------------------------------------------------------

    def run(self) -> Result:
        """Start everything, wait for the end, end everything; Ctrl-C or SIGTERM stops the run in order. Returns what
        happened."""
        with interrupts(self._interrupted):
            self._run()
        if self._origin_time is not None:
            self.result.wall = self._ended - self._origin_time
        self.result.ticks = max((h["tick"] + 1 for h in self.result.health.values()), default=0)
        return self.result

    def _run(self) -> None:
        try:
            modules = {given.cls.rpartition(".")[0] for job in self.jobs.values() for given in members(job)}
            self.nursery.ask({"import": sorted(modules), "inboxes": inboxes(self.jobs, self.joined)})
            for group in self.jobs:
                if group not in self.joined:
                    self._fork(group)
            while any(state != "gone" for state in self._state.values()):
                self._turn()
        finally:
            self.phase = "ended"
            self.printed(self.nursery.close())
            self._wires.close(200)

    _origin_time: float | None = None
    _ended: float = 0.0

    def _interrupted(self) -> None:
        self._interrupts += 1

    def _fork(self, group: str) -> None:
        self._state[group] = "starting"
        self._wires.expect(group)
        self._early.pop(group, None)
        self._seen[group] = time.monotonic()
        self.nursery.ask(
            {
                "start": msgspec.to_builtins(self.jobs[group]),
                "run": self.run_id,
                "control": self._wires.control,
                "reports": self._wires.reports,
            }
        )

    def _turn(self) -> None:
        ready = dict(self._poller.poll(100))
        for group in self._wires.new():
            if group in self._early:
                self._ready(group, self._early.pop(group))
        while (report := self._wires.report()) is not None:
            self._take(report)
        if self.nursery.output.fileno() in ready:
            self._listen()
        if self.nursery.socket.fileno() in ready:
            for answer in self.nursery.answers():
                self._answer(answer)
            if self.nursery.process.poll() is not None:
                self._lost_nursery()
        if self._interrupts > self._heeded:
            self._interrupt()
        self._check_time()
        self.show(self)

    def _listen(self) -> None:
        text = self.nursery.printed()
        if text:
            self._tail = (self._tail + text.splitlines())[-40:]
            self.printed(text)

    # -- reports -------------------------------------------------------------------------------------------------

    def _take(self, report: dict) -> None:
        group, kind = report["group"], report["kind"]
        if group not in self.jobs:
            return
        if self._state[group] == "gone" and kind != "health":
            return  # overtaken by the end of its process, which says the same
        self._seen[group] = time.monotonic()
        match kind:
            case "hello":
                self._wires.tell(f"join-{group}", do="job", job=msgspec.to_builtins(self.jobs[group]), run=self.run_id)
            case "starting":
                self.busy[group] = report["node"]
            case "ready":
                self._ready(group, report)
            case "linked":
                self._state[group] = "linked"
                if self.phase == "linking" and all(s == "linked" for s in self._state.values()):
                    self._go()
                elif self.phase == "running":
                    self._back(group)
            case "health":
                self.result.health.update(report["nodes"])
            case "paused":
                self._paused[group] = report["tick"]
                if len(self._paused) == len(self._leads()):
                    self._wires.tell("*", do="end", tick=max(self._paused.values()))
            case "fault":
                self._died(group, report)
                self._left(group)
            case "note":
                self.result.notes.append(report["text"])
                self.printed(report["text"] + "\n")
            case "rubbish":
                note = f"stream {report['stream']!r}: {report['text']}"
                if note not in self.result.notes:
                    self.result.notes.append(note)
            case "done":
                self._state[group] = "done"
                self._left(group)

    def _left(self, group: str) -> None:
        """A worker on another machine has no process here whose end could be seen: its last report is its end."""
        if group in self.joined:
            self._state[group] = "gone"
            self._ended = time.monotonic()
            self._after_exit()

    def _ready(self, group: str, report: dict) -> None:
        if not self._wires.hears(group):  # its report has overtaken its subscription
            self._early[group] = report
            return
        self._endpoints[group] = report["endpoints"]
        self.busy.pop(group, None)
        self._state[group] = "ready"
        self.result.notes += [n for n in report["refused"] if n not in self.result.notes]
        if self.phase == "running":
            self._link(group)
        elif all(state == "ready" for state in self._state.values()):
            self.phase = "linking"
            for each in self.jobs:
                self._link(each)

    def _link(self, group: str) -> None:
        def nearest(other: str, outlet: str) -> str:
            """The local address where both are on one machine, else the one that the network reaches."""
            addresses = self._endpoints[other][outlet]
            return addresses[0] if (group in self.joined) == (other in self.joined) else addresses[-1]

        others = {name: job for name, job in self.jobs.items() if name != group}
        sources = [(nearest(o, outlet), s) for o, outlet, s in heard(self.jobs[group], others) if o in self._endpoints]
        self._wires.tell(group, **{"do": "connect", "from": sources, "observed": listeners(self.jobs[group], others)})

    def _go(self) -> None:
        self.phase = "running"
        self._origin_time = time.monotonic()
        self.result.start = self._origin_time - self.begun
        self.result.origin = self._origin_time
        self._seen = dict.fromkeys(self.jobs, self._origin_time)
        self.origin = now() + (HEAD_START if self._is_real() else 0)
        self._wires.tell("*", do="go", origin=self.origin)
        for group in self._state:
            self._state[group] = "running"

    def _back(self, group: str) -> None:
        """A worker that was started again joins the run."""
        self._wires.tell(group, do="go", origin=self.origin)
        self._state[group] = "running"
        nodes = {node.name for node in self.jobs[group].nodes}
        self._wires.tell("*", do="alive", nodes=sorted(nodes), mute=sorted(muted(self.jobs.values(), nodes)))

    # -- trouble -------------------------------------------------------------------------------------------------

    def _died(self, group: str, report: dict) -> None:
        self._state[group] = "failed"
        names = [given.name for given in members(self.jobs[group])]
        node = report["node"] or ", ".join(names)
        death = Death(node, report.get("where", "process"), report["text"], report["trace"])
        self.result.deaths.append(death)
        self._bury(group)
        if self.phase == "running":
            self.died(death)

    def _bury(self, group: str) -> None:
        """Tell the others, so that their inputs from this group become None; then end the run, or start it again."""
        dead = {node.name for node in self.jobs[group].nodes}
        self._wires.tell("*", do="dead", nodes=sorted(dead), mute=sorted(muted(self.jobs.values(), dead)))
        again = self._is_real() and self.phase == "running" and dead and dead <= self.restart and self._deadline is None
        if again:
            self._state[group] = "restarting"
        elif dead or self.phase != "running":
            self._end_after(GRACE if self.phase == "running" and self._is_real() else 0.0)

    def _end_after(self, seconds: float) -> None:
        if self._deadline is None:
            self.phase = "ending" if self.phase == "running" else self.phase
            self._quit_at = time.monotonic() + seconds
            self._deadline = self._quit_at + STOP_PATIENCE

    _quit_at: float | None = None

    def _answer(self, answer: dict) -> None:
        if "started" in answer:
            self.pids[answer["started"]] = answer["pid"]
            return
        group, status = answer["exited"], answer["status"]
        # Its last words were sent before its end, but may come after the news of it.
        until = time.monotonic() + (0.5 if status >= 0 else 0.002)
        while self._state[group] in ALIVE and time.monotonic() < until:
            report = self._wires.report(1)
            if report is not None:
                self._take(report)
        state = self._state[group]
        if state in ALIVE:
            how = f"killed by {signal.Signals(-status).name}" if status < 0 else f"exit code {status}"
            text = f"its process ended: {how}"
            self._listen()
            self._died(group, {"node": "", "text": text, "trace": "\n".join(self._tail) if status != -9 else ""})
            state = self._state[group]
        if state == "restarting":
            self._fork(group)
            return
        self._state[group] = "gone"
        self._ended = time.monotonic()
        self._after_exit()

    def _after_exit(self) -> None:
        """When the paced workers are gone the rest has nothing to follow; when all nodes are gone, the observers."""
        left = {group for group, state in self._state.items() if state != "gone"}
        if not left & self._leads() and self._is_real():
            self._wires.tell("*", do="stop")
        if not any(self.jobs[group].nodes for group in left):
            self._wires.tell("*", do="close")
            if self._deadline is None:
                self._deadline = time.monotonic() + 20 * STOP_PATIENCE  # a long queue may have to be written

    def _leads(self) -> set[str]:
        return {job.group for job in self.jobs.values() if job.leads}

    def _is_real(self) -> bool:
        return any(job.clock == "real" for job in self.jobs.values())

    def _lost_nursery(self) -> None:
        self.result.deaths.append(Death("all", "process", "the fork server ended", "\n".join(self._tail)))
        self._state = dict.fromkeys(self._state, "gone")

    def _interrupt(self) -> None:
        """The first Ctrl-C stops the run in order, a second one at once."""
        self._heeded = self._interrupts
        if self.result.interrupted:
            self._kill_rest()
            return
        self.result.interrupted = True
        if self.phase in ("starting", "linking"):
            self._end_after(0.0)
        else:
            self.phase = "ending"
            self._wires.tell("*", do="stop")
            self._deadline = time.monotonic() + STOP_PATIENCE

    def _check_time(self) -> None:
        moment = time.monotonic()
        if self.joined and moment - self._beat > BEAT:
            self._beat = moment
            self._wires.tell("*", do="beat")
        if self._quit_at is not None and moment >= self._quit_at:
            self._quit_at = None
            self._wires.tell("*", do="quit")
            if self.phase in ("starting", "linking"):
                self._deadline = moment + 0.5
        if self._deadline is not None and moment >= self._deadline:
            self._kill_rest()
            self._deadline = moment + STOP_PATIENCE
        if self._deadline is None:
            self._check_hung(moment)

    def _check_hung(self, moment: float) -> None:
        for group, state in self._state.items():
            silent = moment - self._seen[group]
            limit = START_PATIENCE if state == "starting" else self.patience
            joining = state == "starting" and group in self.joined
            if state in ("starting", "running") and silent > limit and not joining:
                self.nursery.ask({"kill": group, "signal": int(signal.SIGUSR1)})  # prints where it hangs
                time.sleep(0.05)
                self._listen()
                names = self.busy.get(group) or ", ".join(n.name for n in self.jobs[group].nodes)
                where = "start" if state == "starting" else "step"
                text = f"no sign of life for {silent:.0f} s: it hangs"
                self._died(group, {"node": names, "where": where, "text": text, "trace": "\n".join(self._tail[-12:])})
                self.nursery.ask({"kill": group, "signal": int(signal.SIGKILL)})
                self._left(group)

    def _kill_rest(self) -> None:
        for group, state in self._state.items():
            if state != "gone":
                self.nursery.ask({"kill": group, "signal": int(signal.SIGKILL)})
                self._state[group] = "killed" if state not in ("done", "failed") else state
                if group not in self.pids:
                    self._state[group] = "gone"
