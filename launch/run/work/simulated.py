"""The loop on the simulated clock: as fast as the machine allows, or paced.

Each node waits for exactly the messages that `schedule` defines, so that the result does not depend on the placement.
Every worker runs its nodes in the graph's order, which excludes deadlocks.
"""

from palpate.engine.clock import now, sleep_until
from palpate.engine.schedule import nanoseconds, next_run
from palpate.engine.segment import CompiledSegment
from palpate.engine.slot import Input, NodeError, Slot
from palpate.engine.tick import run_tick
from palpate.launch.run.reports import Paused
from palpate.launch.run.work.worker import EndedError, Worker
from palpate.messages import Message

BLOCK = 20_000_000  # [ns] time limit of a block of ticks, since Ctrl-C takes effect after it


def run_simulated(worker: Worker, origin: int) -> None:
    """Run the ticks from 0 to the worker's last. `origin` [ns]: time of tick 0, for a paced run."""
    rate, pace, clock = worker.job.rate, worker.job.pace, SimulatedClock(worker)
    lead = next((slot for slot in worker.slots if slot.node.paced), None)
    tick, begun = 0, now()
    while worker.last is None or tick <= worker.last:
        if pace is not None and lead is not None:
            sleep_until(origin + round(nanoseconds(tick, rate) / pace))
        ticks = clock.ahead(tick) if pace is None else 1
        clock.run(tick, ticks)
        tick += ticks
        if lead is not None:
            ended = now()
            lead.health.age.add((ended - begun) // ticks, ticks)
            begun = ended
            if worker.stopping:
                _agree_on_the_end(worker, tick - 1)


class SimulatedClock:
    """Runs the nodes of a worker on simulated time and waits for each input."""

    def __init__(self, worker: Worker) -> None:
        self.worker, self.rate, self.at = worker, worker.job.rate, 0
        self.most = 64  # ticks in a block

    def ahead(self, tick: int) -> int:
        """Number of ticks that can run as one block: more than one if all nodes form one segment."""
        worker = self.worker
        (part, *others) = worker.parts
        if others or not isinstance(part, CompiledSegment) or not part.alone():
            return 1
        return self.most if worker.last is None else max(1, min(worker.last - tick + 1, self.most))

    def run(self, tick: int, ticks: int = 1) -> None:
        """Run the nodes that step at these ticks, then housekeeping."""
        worker, last = self.worker, tick + ticks - 1
        worker.tick = last
        self.at = nanoseconds(last, self.rate)
        if ticks == 1:
            run_tick(worker.parts, tick, self)
        else:
            begun = now()
            (part,) = worker.parts
            assert isinstance(part, CompiledSegment)
            part.run_many(tick, ticks)
            if worker.bus is not None:
                part.hand_over()
            self.most = max(16, self.most // 2) if now() - begun > BLOCK else min(2 * self.most, 1 << 16)
        worker.housekeep()

    def gather(self, slot: Slot, tick: int) -> list[Message | None] | None:
        """Wait for the messages of a step; None: the node was blocked meanwhile."""
        messages: list[Message | None] = [None] * len(slot.inputs)
        for place, port in slot.awaited:
            need = port.need(tick)
            if need >= 0 and not (port.dead or port.inside):
                messages[place] = port.of(need) or _await(self.worker, slot, port, need)
        return None if slot.blocked else messages

    def sent(self, slot: Slot, tick: int) -> None:
        if slot.every > 1:
            slot.due = next_run(tick, slot.every)
        if tick >= slot.sends:
            self.worker.send(slot)


def _await(worker: Worker, slot: Slot, port: Input, need: int) -> Message | None:
    """Wait for the message of tick `need`; None: its sender has died, or the node is blocked."""
    assert port.feed is not None
    try:
        while True:
            came = worker.wait(port.feed)
            if (message := port.of(need)) is not None:
                return message
            if port.lost(need):
                raise NodeError(port.producer, f"stream {port.stream!r}", f"its message of tick {need} was lost")
            if came:
                continue
            if port.dead or slot.blocked:
                return None
            if worker.last is not None and worker.tick > worker.last:
                raise EndedError
            worker.awaits = port.stream, need
    finally:
        worker.awaits = None


def _agree_on_the_end(worker: Worker, tick: int) -> None:
    """Report this tick and wait for the launcher to set the last one: the largest tick of all paced workers."""
    worker.stopping = False
    worker.last = tick if worker.bus is None else None
    worker.report(Paused(tick))
    while worker.last is None:
        worker.pause()
