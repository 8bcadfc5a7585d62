"""The hop of a worker: its compiled nodes with the sockets that they read from and send to.

While the hop is *attached*, the received bytes and the messages of the inputs are in its buffers and records.
`release` returns them to the inlets and ports, where the loops in Python continue from the same state; the next call
attaches again. So every state that compiled code does not handle has one definition, in Python.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from palpate.engine.clock import SPIN, now
from palpate.engine.job import Job
from palpate.engine.segment import CompiledSegment, Entrance
from palpate.engine.slot import Output, RemoteStream, Slot
from palpate.engine.table import ROW
from palpate.engine.tick import run_tick
from palpate.launch.run.hop.pauses import Pauses
from palpate.launch.run.hop.ports import Port, Wire
from palpate.launch.run.hop.table import (
    BETWEEN,
    DONE,
    FAILED,
    HEADER,
    HOP,
    INPUT,
    JOURNAL,
    READER,
    SCRATCH,
    SEGMENT,
    TALLY,
)
from palpate.launch.run.wire.bus import Bus
from palpate.launch.run.wire.inlet import Inlet
from palpate.launch.run.wire.outlet import ReaderConnection, Sender
from palpate.nodes.base import Block

BLOCK = 512  # ticks in one call at most
LONGEST = 40_000_000  # [ns] of a call, since orders and Ctrl-C take effect after it
REAL_LONGEST = 10_000_000  # [ns] of a call on the real clock
FAR = 1 << 62  # a tick after all others


def suits(parts: Sequence[Slot | CompiledSegment]) -> bool:
    """Whether all nodes of a worker are compiled, and the host passes no messages between them."""
    return bool(parts) and all(isinstance(part, CompiledSegment) and not part.receives for part in parts)


def load(real: bool) -> Any:
    """Load or compile the compiled function. Call it before the start barrier: later it would delay the first ticks."""
    from palpate.compiler.entry_point import entry_point  # the compiler is slow to import

    if real:
        from palpate.launch.run.hop.real import run_real_hop

        return entry_point(run_real_hop, 0, 0, 0)
    from palpate.launch.run.hop.tick import run_hop

    return entry_point(run_hop, 0, 0, 0, 0)


class Owner(Protocol):
    """The worker of a hop (`launch.run.work.worker`)."""

    job: Job
    bus: Bus | None
    parts: list[Slot | CompiledSegment]
    outputs: dict[str, Output]
    last: int | None
    tick: int
    feeds: dict[str, RemoteStream]
    pauses: Pauses

    def show(self, block: Block) -> None:
        """Pass messages to the observers."""

    def deliver(self, feed: RemoteStream, payload: bytes) -> None:
        """Pass a received message to the ports that read it."""

    def drain(self) -> None:
        """Release the hop, and read all received messages."""

    def check_length(self, output: Output, tick: int, payload: bytes) -> None:
        """NodeError: the message is longer than a reader accepts."""


class Hop:
    """The table of a worker. Create it when the inlets and the senders are known; `usable` is false if one of them
    leads to another machine."""

    def __init__(self, worker: Owner) -> None:
        assert worker.bus is not None
        self._worker, self._bus, self._kept = worker, worker.bus, list[Any]()
        self._parts: list[CompiledSegment] = worker.parts  # type: ignore[assignment]
        self._state = np.zeros(1, HOP)
        self._ports: list[Port] = []
        self._wires: dict[str, Wire] = {}
        self._segments = np.zeros(len(self._parts), SEGMENT)
        self._readers: list[list[tuple[int, Sender, ReaderConnection]]] = [[] for _ in self._parts]
        self._lines: list[np.ndarray] = [np.zeros(0, READER) for _ in self._parts]
        self._topics: list[list[np.ndarray]] = [[] for _ in self._parts]
        self._known = -1  # version of the readers in the table
        self.attached = False
        senders = {stream: output.send for stream, output in worker.outputs.items()}
        self._senders: dict[str, Sender] = {s: send.__self__ for s, send in senders.items() if send is not None}  # type: ignore[attr-defined]
        self.usable = all(isinstance(feed.inlet, Inlet) for feed in worker.feeds.values()) and not any(
            sender.far for sender in self._senders.values()
        )
        if not self.usable:
            return
        self._real = worker.job.clock == "real"
        self._lead: Slot | None = None
        self._block, self._phase = max(1, min(BLOCK, round(1e-9 * REAL_LONGEST * worker.job.rate))), worker.job.phase
        self._where = self._state.ctypes.data
        self._fill(worker.job)
        self._run = load(self._real)

    def _fill(self, job: Job) -> None:
        base, slots = 0, list[Slot]()
        for line, part in zip(self._segments, self._parts, strict=True):
            ports = [self._port(part, entrance) for entrance in part.entrances()]
            if not self._real:  # the last to arrive first: the others arrive during the wait for it
                ports.sort(key=lambda port: -port.entrance.port.rank)
            places = self._keep(np.array([port.address for port in ports] or [0], np.int64))
            line["rows"], line["clock"] = part.where
            line["port"], line["ports"] = places.ctypes.data, len(ports)
            line["count"], line["base"] = len(part.slots), base
            self._ports += ports
            slots += part.slots
            base += len(part.slots)
        self._slots = slots
        state = self._state[0]
        self._tallies = np.zeros(base, TALLY)
        for line, slot in zip(self._tallies, slots, strict=True):
            line["step"], line["age"] = slot.health.step.words.ctypes.data, slot.health.age.words.ctypes.data
        scratch = self._keep(np.zeros(SCRATCH, np.int64))
        state["segments"], state["count"] = self._segments.ctypes.data, len(self._segments)
        state["scratch"], state["tallies"] = scratch.ctypes.data, self._tallies.ctypes.data
        state["wakes"] = SPIN  # until delays have been measured
        state["exact"], state["period"] = 1e9 / job.rate, round(1e9 / job.rate)

    def _port(self, part: CompiledSegment, entrance: Entrance) -> Port:
        feed = entrance.port.feed
        assert feed is not None
        if feed.stream not in self._wires:
            self._wires[feed.stream] = Wire(feed)
        return Port(part, entrance, self._wires[feed.stream])

    def _keep(self, array: np.ndarray) -> np.ndarray:
        self._kept.append(array)
        return array

    # -- ticks ---------------------------------------------------------------------------------------------------

    def run(self, tick: int, until: int, host: Any) -> int:
        """Run the ticks [tick, until) of the simulated clock as far as one call goes; returns the next tick. `host`
        completes an interrupted tick. NodeError: a node failed."""
        self._prepare()
        reached, why = self._run(self._where, tick, min(until, tick + BLOCK), now() + LONGEST)
        if why == DONE:
            self._hand_over()
            return reached
        host.begins(reached)
        self._complete(reached, why, host)
        return reached + 1

    def run_real(self, host: Any, origin: int, lead: Slot, until: int | None) -> int:
        """Run ticks of the real clock as far as one call goes; returns their number. 0: the next one does not begin
        soon, or it begins in a way that the loop in Python handles. NodeError: a node failed.

        origin  [ns] time of tick 0;  lead  the node whose input or clock starts a tick
        until   [ns] after which the first driver of the lead is not waited for; None: it is the only one
        """
        if not self._set_lead(lead):
            return 0
        state, worker = self._state[0], self._worker
        sends = worker.pauses.unsent  # then the messages of this tick wait in the journals: no node awaits them
        self._prepare()
        state["origin"], state["last"], state["begun"] = origin, worker.tick, host.deadline - host.period
        state["held"] = 0 if until is None else until - state["begun"]
        state["end"] = FAR if worker.last is None else worker.last
        # Each worker returns to Python after other ticks than the others, since they share the core.
        most = 1 if self._bus.served_readers() or sends else self._block - (worker.tick + 1 + self._phase) % self._block
        why = self._run(self._where, most, now() + 2 * REAL_LONGEST)
        ran, worker.tick = int(state["done"]), int(state["last"])
        if why in (DONE, BETWEEN):
            if not (sends and ran):
                self._hand_over()
            if ran:
                host.begins(worker.tick, int(state["time"]), int(state["begun"]))
            else:
                self.release()
            return ran
        host.begins(int(state["now"]), int(state["time"]), int(state["begun"]))
        self._complete(worker.tick, why, host)
        return ran + 1

    def _set_lead(self, lead: Slot) -> bool:
        """Enter the leading node; False: its driving message comes from this process."""
        state = self._state[0]
        if not state["lead"]:
            at, place = next((k, part.slots.index(lead)) for k, part in enumerate(self._parts) if lead in part.slots)
            state["lead"] = self._parts[at].where[0] + place * ROW.itemsize
            driving = None if lead.node.paced else lead.inputs[0]
            address = next((port.address for port in self._ports if port.entrance.port is driving), 0)
            self._led = lead.node.paced or address != 0
            state["port"], self._lead = address, lead
        return self._led

    def count(self) -> None:
        """Copy from the table to the slots: counts, and tick and time of the last step. Compiled code itself counts
        durations and ages."""
        state = self._state[0]
        for slot, overdue in zip(self._slots, self._tallies["overdue"].tolist(), strict=True):
            slot.health.overdue += overdue
        self._tallies["overdue"] = 0
        if self._lead is not None:
            self._lead.health.late += int(state["late"])
            self._lead.health.lost += int(state["lost"])
        state["late"] = state["lost"] = 0
        for part in self._parts:
            part.copy_times()
        for line, readers in zip(self._lines, self._readers, strict=True):
            for k, (_, _, reader) in enumerate(readers):
                reader.dropped += int(line["dropped"][k])
            line["dropped"] = 0

    def lacks_sender(self) -> bool:
        """Whether a connection is not established, or a sender has died: Python connects again."""
        return self.attached and any(
            wire.line["fd"][0] < 0 or any(port.entrance.port.dead for port in wire.ports)
            for wire in self._wires.values()
        )

    def _complete(self, tick: int, why: int, host: Any) -> None:
        """Complete an interrupted tick in Python."""
        state = self._state[0]
        self.count()
        at = int(state["at"])
        part, segment = self._parts[at], self._segments[at]
        if why in (JOURNAL, FAILED):
            state["entry"], state["reader"], state["sent"] = segment["first"], 0, 0
        if why == INPUT:
            self._hand_over()
            if self._real:
                self._worker.drain()  # also notices that a sender has closed its connection
            else:
                self.release()
        else:
            unsent = self._unsent(part, at)
            self._hand_over()
            self.release()
            for sender, reader, data, sent in unsent:
                sender.write(reader, data, sent)
            if why == FAILED:
                raise part.node_error()
            if why == JOURNAL:
                part.resume(tick)
            part.deliver_tick(tick, host)
            at += 1
        run_tick(self._parts[at:], tick, host)

    def _unsent(self, part: CompiledSegment, at: int) -> list[tuple[Sender, ReaderConnection, bytes, int]]:
        """Find the unsent messages of a tick: frame, reader, and number of bytes sent before."""
        state, left = self._state[0], []
        block = part.block()
        if block is None:
            return []
        first, reader, sent = int(state["entry"]), int(state["reader"]), int(state["sent"])
        for k, (stream, tick, payload) in enumerate(block.messages()):
            if k < first:
                continue
            if k > first:
                reader = 0
            output = self._worker.outputs[stream]
            if output.send is not None:
                self._worker.check_length(output, tick, payload)
            for number, sender, one in self._readers[at][reader:]:
                if number == block.entries["number"][k]:
                    left.append((sender, one, sender.frame_payload(payload), sent))
                sent = 0
        return left

    def _hand_over(self) -> None:
        """Give the messages in the journals, which have been sent, to the observers."""
        for part in self._parts:
            block = part.block()
            if block is not None:
                self._worker.show(block)
                self._worker.pauses.handed |= part.collects
                part.clear()

    # -- sockets -------------------------------------------------------------------------------------------------

    def _prepare(self) -> None:
        """Attach, and renew what has changed since the last call: the readers, and which messages are observed."""
        if not self.attached:
            self._attach()
        if self._known != self._bus.readers():
            self._renew()
        for at, (line, readers) in enumerate(zip(self._lines, self._readers, strict=True)):
            if len(readers):
                line["queued"][: len(readers)] = [bool(reader.rest) for _, _, reader in readers]
            outputs = [output for slot in self._parts[at].slots for output in slot.outputs]
            self._segments["keeps"][at] = any(output.observed or output.listeners for output in outputs)

    def _renew(self) -> None:
        """Make the table of the readers. A closed descriptor may have been opened again for something else."""
        self.count()
        self._known = self._bus.readers()
        for at, part in enumerate(self._parts):
            readers = [
                (part.number(stream), sender, reader)
                for stream, sender in self._senders.items()
                if part.number(stream) >= 0
                for reader in sender.readers
            ]
            lines = np.zeros(max(1, len(readers)), READER)
            topics = [np.frombuffer(bytes(HEADER) + sender.topic, np.uint8).copy() for _, sender, _ in readers]
            for line, topic, (number, _, reader) in zip(lines, topics, readers, strict=False):
                line["number"], line["fd"], line["blocks"] = number, reader.end.fileno(), self._bus.waits_for(reader)
                line["worker"] = bool(reader.group)
                line["topic"], line["skip"] = topic.ctypes.data + HEADER, len(topic) - HEADER
            self._readers[at], self._lines[at] = readers, lines
            self._segments["reader"][at], self._segments["readers"][at] = lines.ctypes.data, len(readers)
            self._topics[at] = topics

    def _attach(self) -> None:
        """Take the received bytes and messages from the inlets and ports."""
        for wire in self._wires.values():
            wire.attach()
        for port in self._ports:
            port.attach()
        self.attached = True

    def release(self) -> None:
        """Return the received bytes and messages to the inlets and ports. NodeError: a message is not of its type."""
        if not self.attached:
            return
        self.attached = False
        self.count()
        for port in self._ports:
            port.release()
        for wire in self._wires.values():
            for payload in wire.release():
                self._worker.deliver(wire.feed, payload)
