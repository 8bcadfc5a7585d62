"""Plays a recording of simulated time with compiled nodes: one call of compiled code per tick, as in a run."""

from collections.abc import Iterable, Mapping, Sequence
from time import perf_counter_ns, thread_time_ns
from typing import Any

import numpy as np

from palpate.engine.plan import Plan
from palpate.engine.segment import CompiledSegment, segments
from palpate.engine.slot import Slot
from palpate.messages import Message
from palpate.nodes.base import Block, CompiledNode
from palpate.records.player import Player, ReplaySlot
from palpate.records.stored import Stored

SHARE = 1.0 / 3.0  # of the ticks in which nodes are measured
GOLDEN = 0.6180339887498949  # spreads these ticks over the steps of a node with any divisor

Ticks = Mapping[str, np.ndarray]


def live_player(recording: Stored, plan: Plan, running: Sequence[str], present: Ticks, encode: bool = True) -> Player:
    """A player in which nodes read the computed messages of one another. See `Player`.

    present  ticks of the messages of each stream
    encode   whether its `step` returns messages
    """
    kinds = [plan.graph.nodes[name].cls for name in running]
    compiled = all(issubclass(kind, CompiledNode) and kind.step is CompiledNode.step for kind in kinds)
    if compiled and _follows_simulated_time(recording, present):
        return SegmentPlayer(recording, plan, running, encode)
    return Player(recording, plan, running, live=True)


def _follows_simulated_time(recording: Stored, present: Ticks) -> bool:
    """Whether the rules of simulated time determine the messages that each step used: no node died or was restarted,
    and no message is missing."""
    rows = {name: row.astype(int) for name, row in present.items()}
    if recording.about.get("clock") != "simulated" or recording.restarted or not all(map(len, rows.values())):
        return False
    last = max((row[-1] for row in rows.values()), default=-1)
    every = {name: recording.streams[name].every * recording.streams[name].thin for name in rows}
    return all(row[-1] + 2 * every[name] > last and (np.diff(row) == every[name]).all() for name, row in rows.items())


class SegmentPlayer(Player):
    """A `Player` of compiled nodes on the rules of simulated time. Arguments as for `live_player`."""

    def __init__(self, recording: Stored, plan: Plan, running: Iterable[str], encode: bool) -> None:
        super().__init__(recording, plan, running, live=True)
        outputs = {output.stream: output for part in self.parts for output in part.outputs}
        for part in self.parts:
            for port in part.inputs:
                port.output = outputs.get(port.stream)
        for output in outputs.values():
            output.observed = encode
        self._encoded: dict[str, bytes] = {}
        self._segments: list[Any] = []

    def start(self) -> None:
        """Start all nodes and join them. NodeError: one raised."""
        super().start()
        self._segments = segments(self.parts, lambda slots: _TimedSegment(slots, self.rate, self._take_block))
        for part in self.parts:
            part.cpu = part.health.step  # calls of a few microseconds, which other programs rarely interrupt

    def step(self, tick: int, payloads: dict[str, bytes], now: int | None = None) -> dict[str, bytes]:
        self._encoded = {}
        self._advance(tick, payloads, now)
        return self._encoded

    def time_step(self, tick: int, payloads: dict[str, bytes]) -> tuple[int, int] | None:
        self._advance(tick, payloads, None)
        taken = [segment.taken for segment in self._segments]
        return None if None in taken else (sum(wall for wall, _ in taken), sum(cpu for _, cpu in taken))

    def _advance(self, tick: int, payloads: dict[str, bytes], now: int | None) -> list[ReplaySlot]:
        self.deliver_messages(tick, payloads)
        for segment in self._segments:
            segment.run(tick, self)
        return []

    def gather(self, part: Slot, tick: int) -> list[Message | None] | None:
        """The played messages of a step; None: a required one is not in the recording."""
        messages: list[Message | None] = [None] * len(part.inputs)
        for place, port in part.awaited:
            need = port.need(tick)
            if need >= 0 and not (port.dead or port.inside):
                messages[place] = message = port.of(need)
                if message is None and not port.port.optional:
                    return None
        return messages

    def take_outputs(self, part: Slot, tick: int) -> None:
        pass

    def _take_block(self, block: Block) -> None:
        self._encoded |= {stream: payload for stream, _, payload in block.messages()}


class _TimedSegment(CompiledSegment):
    """A segment that measures the nodes one by one in a third of its ticks, and the others as a whole.

    taken  duration and processor time of the last tick [ns]; None: its nodes were measured
    """

    def __init__(self, slots: list[Slot], rate: float, deliver: Any) -> None:
        super().__init__(slots, rate, False, lambda slot, port: 0.0, deliver)
        self.taken: tuple[int, int] | None = None
        self.refresh()

    def measures_nodes(self, tick: int) -> bool:
        return tick * GOLDEN % 1.0 < SHARE

    def _call(self, tick: int, ticks: int) -> None:
        self.taken = None
        if self.measures_nodes(tick):
            super()._call(tick, ticks)
            return
        begun, used = perf_counter_ns(), thread_time_ns()
        super()._call(tick, ticks)
        self.taken = perf_counter_ns() - begun, thread_time_ns() - used
