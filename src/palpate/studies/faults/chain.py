"""A graph by the rules of the real clock in virtual time: each node runs as in a separate process, with messages that
are late, lost or not sent. Only tick numbers count, so the result does not depend on the machine."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from heapq import heapify, heappop, heappush
from itertools import count
from typing import Any, NamedTuple

from msgspec.structs import replace

from palpate.engine.slot import Input, Slot, make
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.wire.wires import blocked_by
from palpate.launch.run.work.expiry import end_inputs
from palpate.launch.run.work.real import WAITED, take_inputs
from palpate.messages import Contact, DeviceState, Force, Message, Pose, Torque
from palpate.nodes.device import Simulated

Lost = Callable[[str, str, int], bool]
"""Whether the message of a stream to a node is lost at a tick."""
Fate = Callable[[str, str, int], tuple[int, ...]]
"""Delays [ticks] of the copies of a message of a stream to a node: empty if it is lost, two if it is duplicated."""


ELSEWHERE: Any = object()
"""The stream of another process."""


def nothing(stream: str, reader: str, tick: int) -> bool:
    """Lose no message."""
    return False


class Hand(NamedTuple):
    """The device of a hand, the node with its pose, and the stream of its contact."""

    device: Slot
    pose: Slot
    contact: str


class _Clock:
    """What a step needs of a worker: virtual time [ns], which passes while it waits for a message in vain."""

    stopping = False

    def __init__(self, job: Any) -> None:
        self.job, self.at, self.period = job, 0, round(1e9 / job.rate)

    def now(self) -> int:
        return self.at

    def wait(self, feed: object, deadline: int | None = None) -> None:
        self.at += self.period


class Chain:
    """The nodes of a launch file, message by message.

    late    delay of a message [ticks]
    lost    which messages are lost
    fate    delays of the messages; by default according to `late` and `lost`
    sent    callback for every sent message
    halted  whether a node is stopped at a tick, as by SIGSTOP
    events  what happened last, if it is a deque: tick, event, node or stream
    rate    [Hz]
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
                port.feed = ELSEWHERE  # no message arrives while a step waits
            slot.start()
        self.readers: dict[str, list[tuple[str, Input]]] = {}
        for slot in self.slots:
            for port in slot.inputs:
                self.readers.setdefault(port.stream, []).append((slot.name, port))
        self.clock = _Clock(job)
        self.rate: float = job.rate
        self.events: deque[tuple[int, str, str]] | None = None
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
                port.quiet = False
        self.way.clear()
        self.tick = self.clock.at = 0
        self.ran = {slot.name: -1 for slot in self.slots}

    def run(self, ticks: int, stopped: str = "") -> None:
        """Run some ticks; without a node, if it is named."""
        for _ in range(ticks):
            self._tick([slot for slot in self.slots if slot.name != stopped])

    def play(self, poses: Iterable[Sequence[Pose]]) -> None:
        """Run the nodes after the first poses of the graph, with these in their place: for each tick one of each hand,
        in the order of `hands`."""
        first = [hand.pose for hand in self.hands]
        streams = [next(output.stream for output in slot.outputs if output.kind is Pose) for slot in first]
        after = [slot for slot in self.slots if slot not in first and not slot.node.paced]
        for row in poses:
            for stream, pose in zip(streams, row, strict=True):
                self._send(stream, replace(pose, tick=self.tick, time=self.tick * self.clock.period))
            self._tick(after)

    def _tick(self, slots: Sequence[Slot]) -> None:
        self._arrive()
        for slot in slots:
            if not slot.blocked and not self.halted(slot.name, self.tick):
                self._step(slot)
                self._arrive()
        self.tick += 1

    def stall(self, ticks: int) -> None:
        """No node is scheduled for this number of ticks."""
        self._note("stall", f"{ticks} ticks")
        self.tick += ticks

    def die(self, name: str) -> None:
        """A node ends; its readers are notified at once, and those that require it wait."""
        self._note("dies", name)
        self._death({name}, back=False)
        self.slot(name).blocked = True

    def revive(self, name: str) -> None:
        """The node returns with its initial state."""
        self._note("returns", name)
        slot = self.slot(name)
        slot.begin()
        for port in slot.inputs:
            port.quiet = False
        slot.node.replaces()
        self.ran[name] = self.tick - 1
        self.way = [entry for entry in self.way if entry[2] not in slot.inputs]
        heapify(self.way)
        self._death({name}, back=True)
        slot.blocked = False

    def _death(self, nodes: set[str], back: bool) -> None:
        end_inputs(self.slots, nodes, blocked_by([self.clock.job], nodes), back)

    def slot(self, name: str) -> Slot:
        return next(slot for slot in self.slots if slot.name == name)

    def _arrive(self) -> None:
        while self.way and self.way[0][0] <= self.tick:
            _, _, port, message = heappop(self.way)
            port.put(message)

    def _send(self, stream: str, message: Message) -> None:
        for reader, port in self.readers.get(stream, ()):
            ways = self._fate(stream, reader, message.tick)
            if ways != (0,):
                self._note(f"late {ways}" if ways else "lost", f"{stream} -> {reader}")
            for late in ways:
                if late == 0:
                    port.put(message)
                else:
                    heappush(self.way, (self.tick + late, next(self._sent), port, message))

    def _fate(self, stream: str, reader: str, tick: int) -> tuple[int, ...]:
        if self.fate is not None:
            return self.fate(stream, reader, tick)
        return () if self.lost(stream, reader, tick) else (self.late,)

    def _step(self, slot: Slot) -> None:
        tick = self.tick
        if slot.drivers:
            slot.hear(self.ran[slot.name], tick - self.ran[slot.name] > WAITED * slot.inputs[0].every)
        driver = slot.driver
        if driver is not None:
            if not driver.queue or driver.queue[-1].tick <= self.ran[slot.name]:
                return
            tick = driver.queue[-1].tick
        messages = take_inputs(self.clock, slot, tick, self.clock.at + self.clock.period, leading=True)
        if messages is None:
            self._note("waits", slot.name)
        else:
            slot.due = tick + slot.every
            slot.step(tick, tick * self.clock.period, messages, 1.0 / self.rate)
            self.ran[slot.name] = tick
            for output in slot.outputs:
                if output.last is not None:
                    self.sent(output.stream, output.last)
                    self._send(output.stream, output.last)

    def _note(self, event: str, where: str) -> None:
        if self.events is not None:
            self.events.append((self.tick, event, where))

    @property
    def hands(self) -> list[Hand]:
        """The hands, each on a device."""
        return [self._hand(slot) for slot in self.slots if slot.node.paced]

    def _hand(self, device: Slot) -> Hand:
        """A hand by the nodes that its torque comes through, backwards to its contact."""
        senders = {output.stream: (slot, output.kind) for slot in self.slots for output in slot.outputs}
        pose = next(slot for slot in self._readers(device) if any(output.kind is Pose for output in slot.outputs))
        found, contact = [device], ""
        for slot in found:
            controls = any(output.kind is Force for output in slot.outputs)
            for stream in (port.stream for port in slot.inputs):
                sender, kind = senders.get(stream, (device, DeviceState))
                if kind is Contact and controls:
                    contact = stream
                if kind in (Torque, Force) and sender not in found:
                    found.append(sender)
        return Hand(device, pose, contact)

    def _readers(self, slot: Slot) -> list[Slot]:
        streams = {output.stream for output in slot.outputs}
        return [reader for reader in self.slots if any(port.stream in streams for port in reader.inputs)]

    @property
    def device(self) -> Slot:
        """The first paced node."""
        return next(slot for slot in self.slots if slot.node.paced)

    def torque(self, device: Slot | None = None) -> float:
        """The largest torque that a device, by default the first one, uses after its last step."""
        slot = device or self.device
        node, held, sent = slot.node, slot.inputs[0].message, slot.outputs[0].last
        if isinstance(node, Simulated):
            return float(max(map(abs, node.own["applied"])))
        there = isinstance(held, Torque) and sent is not None and sent.used[0] >= 0
        return max(map(abs, held.torques)) if there else 0.0  # type: ignore[union-attr]
