"""One simulated run: the product's launcher and workers, with the faults of a scene."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from palpate.engine import clock
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.reports import Alive, Gone, Order, Report
from palpate.studies.faults.launcher import nodes
from palpate.studies.faults.launcher.control import Sockets
from palpate.studies.faults.launcher.machine import Far, SimulatedForkServer
from palpate.studies.faults.launcher.outcome import Outcome, Struck, Worked
from palpate.studies.faults.launcher.process import Process
from palpate.studies.faults.launcher.readings import Net
from palpate.studies.faults.launcher.scene import Fault, Scene
from palpate.studies.faults.launcher.world import MS, SECOND, KilledError, World

LIMIT = 60  # [s] after the last fault and the last tick, in which any run must end
START_LIMIT = 140  # [s] more if a call of `start` or `stop` hangs, see `watchdog.START_PATIENCE`
AWAIT = 600  # [s] of a join for its launcher
AFTER = 12 * SECOND  # [ns] after the end of the launcher, in which joined workers end


@contextmanager
def virtual_time(world: World) -> Iterator[None]:
    """Within this context the clock of launcher and workers is that of the simulation."""
    known = clock.now, clock.sleep_until
    clock.now, clock.sleep_until = world.now, world.sleep_until  # type: ignore[assignment]
    try:
        yield
    finally:
        clock.now, clock.sleep_until = known  # type: ignore[assignment]


class Run:
    """A scene in progress."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.outcome = scene, Outcome(scene)
        ends = [fault.moment.at or 0.0 for fault in scene.faults] + [(scene.ticks or 0) / scene.rate]
        hangs = any(
            f.kind in ("hang", "stop") or (f.kind in ("kill", "power", "exit") and scene.joined) for f in scene.faults
        )
        limit = LIMIT + 20 * max(ends) + sum(f.duration for f in scene.faults) + START_LIMIT * hangs
        self.world = World(str(scene.seed), int((1 + limit) * SECOND) + AFTER, scene.slow)
        self._limit = self.world.limit - AFTER
        self._launching = Process(self.world, "launcher", self._launch)
        self.launcher: Launcher | None = None
        self._net = Net()
        self._forkserver = SimulatedForkServer(self.world, self._net, self._launching)
        self._sockets = Sockets(self.world, self._launching)
        self._forkserver.sockets = self._sockets
        self._forkserver.begun = self._begin_worker
        self._sockets.watch, self._sockets.watch_orders = self._watch_report, self._watch_order
        self._workers: dict[str, Process] = {}
        self._reported: dict[tuple[str, str], int] = {}
        self._ended: set[str] = set()  # processes whose nodes have reported an end
        self._calls: dict[tuple[str, str], int] = {}
        self._far: dict[str, Far] = {}
        self._steps = dict(scene.steps)

    def go(self) -> Outcome:
        world = self.world
        world.start(self._launching)
        for group in sorted(self.scene.joined):
            delay = int(world.random_of(f"joins {group}").random() * 0.5 * SECOND)
            far = self._far[group] = Far(world, self._net, self._sockets, group, delay, AWAIT * SECOND)
            self._workers[group] = far.worker
            self._watch_end(group, far.worker)
        for fault in self.scene.faults:
            if fault.moment.at is not None:
                world.after(int(fault.moment.at * SECOND), lambda fault=fault: self._strike(fault))  # type: ignore[misc]
        world.finished = self._is_over
        nodes.watchers.append(self)
        try:
            with virtual_time(world):
                world.run()
        except Exception as error:
            self.outcome.error = self.outcome.error or error
        finally:
            nodes.watchers.remove(self)
        self._collect()
        return self.outcome

    def _is_over(self) -> bool:
        if self.outcome.result is None and self.outcome.error is None:
            return self.world.time > self._limit
        return self.world.time > self.outcome.returned + AFTER or not any(
            far.worker.alive for far in self._far.values()
        )

    def _collect(self) -> None:
        outcome = self.outcome
        outcome.events = tuple(self.world.log)
        outcome.late = [
            group
            for group, far in self._far.items()
            if far.taken and far.worker.alive and not far.worker.stopped and not far.worker.hangs
        ]
        if self.launcher is not None:
            outcome.states = {group: member.state for group, member in self.launcher.members.items()}

    # -- the launcher ----------------------------------------------------------------------------------------------

    def _launch(self) -> int:
        scene = self.scene
        try:
            self.launcher = Launcher(
                scene.jobs(),
                self._forkserver,  # type: ignore[arg-type]
                sockets=lambda run, address, key: self._sockets,  # type: ignore[arg-type, return-value]
                joined=scene.joined,
                address="tcp://10.0.0.1:5600" if scene.joined else None,
                patience=scene.patience,
                restart=scene.restart,
                spared=scene.spared,
                show=self._show,
            )
            self.launcher.run_id = "run"
            result = self.launcher.run()
        except Exception as error:
            self.outcome.error = error
            return 1
        finally:
            self.outcome.returned = self.world.time
        self.outcome.result = result
        self.world.note(f"the launcher returns, deaths {[death.node for death in result.deaths]}")
        return 0

    def _show(self, launcher: Launcher) -> None:
        if not self.outcome.begun and launcher.phase == "running":
            self.outcome.begun = self.world.time
        if all(member.state == "gone" for member in launcher.members.values()) and self._forkserver.alive:
            self.outcome.left = [process.name for process in self._forkserver.workers if process.alive]

    # -- what the processes do -------------------------------------------------------------------------------------

    def _begin_worker(self, group: str, process: Process) -> None:
        self._workers[group] = process
        self.world.note(f"{process.name} is forked")
        self._watch_end(group, process)

    def _watch_end(self, group: str, process: Process) -> None:
        worked = Worked(group, process.name, self.world.time)
        self.outcome.workers.append(worked)
        process.on_end.append(lambda: setattr(worked, "ended", self.world.time))

    def _watch_order(self, name: str, order: Order) -> None:
        """An order has arrived at a worker."""
        if isinstance(order, Gone) and not order.back:
            self.outcome.gone += [(node, name, self.world.time) for node in order.nodes]

    def _watch_report(self, name: str, report: Report) -> None:
        """A worker sends a report."""
        group, kind = name.split()[0], type(report).__name__
        self.world.note(f"{name} reports {kind}{str(report)[len(kind) : 60] if kind != 'Alive' else ''}")
        if kind in ("NodesEnded", "NodeFault"):
            self._ended.add(name)
        if isinstance(report, Alive) and any(counters.steps for counters in report.nodes.values()):
            self.outcome.stepped.setdefault(name, self.world.time)
        count = self._reported[group, kind] = self._reported.get((group, kind), 0) + 1
        for fault in self.scene.faults:
            if fault.group == group and fault.moment.report == kind and fault.moment.count == count:
                self.world.after(int(fault.moment.delay * SECOND), lambda fault=fault: self._strike(fault))  # type: ignore[misc]

    def act(self, node: str, call: str) -> None:
        """A node's call: it takes time, or fails."""
        process = self.world.check()
        process.call = node if call == "step" else ""
        count = self._calls[node, call] = self._calls.get((node, call), 0) + 1
        try:
            self.world.compute(int(self._steps.get(node, 1e-5) * SECOND) if call == "step" else MS)
        except KilledError:
            if call != "stop":  # the product would print it
                raise
            return
        for fault in self.scene.faults:
            second = call == "stop" and process.name in self._ended  # the product prints a second failure
            if fault.node == node and fault.moment.call == call and fault.moment.count == count and not second:
                self._note(fault)
                if fault.kind == "raise":
                    raise RuntimeError("out of luck")
                process.hangs = True
                self.world.wait(None, lambda: False)
        process.call = ""

    def take(self, stream: str, tick: int) -> None:
        self.outcome.received.setdefault(stream, []).append(tick)

    # -- faults ----------------------------------------------------------------------------------------------------

    def _note(self, fault: Fault) -> None:
        launcher, group = self.launcher, fault.group
        member = launcher.members.get(group) if launcher is not None else None
        process = self._workers.get(group)
        self.outcome.struck.append(
            Struck(
                fault,
                self.world.time,
                "starting" if launcher is None else launcher.phase,
                launcher is not None and launcher._ending.near,
                member.state if member is not None else "",
                process is not None and process.name in self._ended,
                member is None or not member.joined or member.taken,
            )
        )
        self.world.note(f"FAULT {fault}")

    def _strike(self, fault: Fault) -> None:
        process, duration = self._workers.get(fault.group), int(fault.duration * SECOND)
        if self.outcome.result is not None or (fault.group and (process is None or process.killed)):
            return
        self._note(fault)
        match fault.kind:
            case "server":
                self.world.kill(self._forkserver.process)
            case "interrupt" if self.launcher is not None:
                self.launcher._interrupts.append(signal.SIGINT)
            case "stall":
                self._pause(self._launching, duration)
        if process is not None:
            self._strike_worker(fault, process, duration)

    def _strike_worker(self, fault: Fault, process: Process, duration: int) -> None:
        far = self._far.get(fault.group)
        match fault.kind:
            case "kill":
                self.world.kill(process)
            case "exit":
                self.world.kill(process, fault.status)
            case "stop":
                self.world.stop(process)
            case "pause":
                self._pause(process, duration)
            case "leave":
                self.world.interrupt(process)
            case "break" if far is not None:
                for line in far.lines:
                    line.break_(duration)
            case "part" if far is not None:
                self.world.note(f"the connections of {process.name} to other workers break")
                for reading in tuple(self._net.readings):
                    if fault.group in (reading.group, reading.reader.group):
                        reading.break_(duration)
            case "power" | "helper" if far is not None:
                for each in (far.helper, far.worker if fault.kind == "power" else None):
                    if each is not None:
                        self.world.kill(each)

    def _pause(self, process: Process, duration: int) -> None:
        """Stop a process for a time [ns]."""
        if not process.stopped:
            self.world.stop(process)
            self.world.after(duration, lambda: self.world.resume(process))


def simulate(scene: Scene) -> Outcome:
    """Run a scene to its end, or to its limit."""
    return Run(scene).go()
