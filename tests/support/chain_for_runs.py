"""A graph by the rules of the real clock on a simulated clock: each node runs as in a separate process, with messages
that are late, lost or not sent. Only tick numbers count, so the result does not depend on the machine."""

from collections.abc import Callable
from heapq import heapify, heappop, heappush
from itertools import count
from types import SimpleNamespace

from palpate.engine.slot import Input, Slot, make
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.wire.wires import blocked_by
from palpate.launch.run.work import real
from palpate.launch.run.work.worker import Worker
from palpate.messages import Message
from palpate.nodes.device import Simulated

Lost = Callable[[str, str, int], bool]
"""Whether the message of a stream to a node is lost at a tick."""
Fate = Callable[[str, str, int], tuple[int, ...]]
"""Delays [ticks] of the copies of a message of a stream to a node: empty if it is lost, two if it is duplicated."""


def nothing(stream: str, reader: str, tick: int) -> bool:
    """Lose no message."""
    return False


class Chain:
    """The nodes of a launch file, message by message.

    late  delay of a message [ticks]
    lost  which messages are lost
    fate  delays of the messages; by default according to `late` and `lost`
    sent  callback for every sent message
    halted  whether a node is stopped at a tick, as by SIGSTOP
    """

    def __init__(self, launch: LaunchFile, late: int = 0, lost: Lost = nothing) -> None:
        launch = launch.but(place="fused")
        graph = launch.load()
        set_recording(graph, None)
        job = next(job for job in jobs(plan(graph), launch.placement(plan(graph)), clock="real") if job.leads)
        assert {given.name for given in job.nodes} == set(plan(graph).order)
        self.slots = [Slot(given, make(given), ()) for given in job.nodes]
        for slot in self.slots:
            slot.wire({})
            for port in slot.inputs:
                port.feed = object()  # from another process; no message arrives while a step waits
            slot.start()
        self.worker = SimpleNamespace(job=job, wait=self._pass, stopping=False)
        self.late, self.lost = late, lost
        self.fate: Fate | None = None
        self.way: list[tuple[int, int, Input, Message]] = []
        self._sent = count()
        self.sent: Callable[[str, Message], None] = lambda stream, message: None
        self.halted: Callable[[str, int], bool] = lambda node, tick: False
        self.begin()

    def begin(self) -> None:
        """Restart, with the existing kernels and meshes."""
        for slot in self.slots:
            slot.begin()
            slot.due = 0
            slot.blocked = False
            for port in slot.inputs:
                port.queue.clear()
                port.message = None
                port.dead = not port.stream
        self.way.clear()
        self.tick, self.clock = 0, 0
        self.ran = {slot.name: -1 for slot in self.slots}

    def _pass(self, feed: object, deadline: int = 0) -> None:
        self.clock += 1_000_000

    def now(self) -> int:
        return self.clock

    def run(self, ticks: int, stopped: str = "") -> None:
        for _ in range(ticks):
            self._arrive()
            for slot in self.slots:
                if slot.name != stopped and not slot.blocked and not self.halted(slot.name, self.tick):
                    self._step(slot)
                    self._arrive()
            self.tick += 1

    def stall(self, ticks: int) -> None:
        """No node is scheduled for this number of ticks."""
        self.tick += ticks

    def die(self, name: str) -> None:
        """A node ends; its readers are notified at once, and those that require it wait."""
        self._death({name}, back=False)
        self._slot(name).blocked = True

    def revive(self, name: str) -> None:
        """The node returns with its initial state."""
        slot = self._slot(name)
        slot.begin()
        slot.node.replaces()
        self.ran[name] = self.tick - 1
        self.way = [entry for entry in self.way if entry[2] not in slot.inputs]
        heapify(self.way)
        self._death({name}, back=True)
        slot.blocked = False

    def _death(self, nodes: set[str], back: bool) -> None:
        blocked = blocked_by([self.worker.job], nodes)
        Worker._handle_deaths(SimpleNamespace(slots=self.slots, parts=(), hop=None), nodes, blocked, back)

    def _slot(self, name: str) -> Slot:
        return next(slot for slot in self.slots if slot.name == name)

    def _arrive(self) -> None:
        while self.way and self.way[0][0] <= self.tick:
            _, _, port, message = heappop(self.way)
            port.put(message)

    def _send(self, stream: str, message: Message) -> None:
        for slot in self.slots:
            for port in slot.inputs:
                if port.stream == stream:
                    for late in self._fate(stream, slot.name, message.tick):
                        heappush(self.way, (self.tick + late, next(self._sent), port, message))

    def _fate(self, stream: str, reader: str, tick: int) -> tuple[int, ...]:
        if self.fate is not None:
            return self.fate(stream, reader, tick)
        return () if self.lost(stream, reader, tick) else (self.late,)

    def _step(self, slot: Slot) -> None:
        driver = slot.driver
        tick = self.tick
        if driver is not None:
            if not driver.queue or driver.queue[-1].tick <= self.ran[slot.name]:
                return
            tick = driver.queue[-1].tick
        messages = real._gather(self.worker, slot, tick, self.clock + 1_000_000, leading=True)
        if messages is not None:
            slot.due = tick + slot.every
            slot.step(tick, tick * 1_000_000, messages, 1e-3)
            self.ran[slot.name] = tick
            for output in slot.outputs:
                self.sent(output.stream, output.last)
                self._send(output.stream, output.last)

    @property
    def device(self) -> Slot:
        """The paced node."""
        return next(slot for slot in self.slots if slot.node.paced)

    def torque(self) -> float:
        """The largest torque that the device uses after its last step."""
        node, port = self.device.node, self.device.inputs[0]
        if isinstance(node, Simulated):
            return max(map(abs, node.own["applied"]))
        there = self.device.outputs[0].last.used[0] >= 0 and port.message is not None
        return max(map(abs, port.message.torques)) if there else 0.0
