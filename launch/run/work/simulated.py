"""The loop on the simulated clock: as fast as the machine allows, or paced.

Each node waits for exactly the messages that `schedule` defines, so that the result does not depend on the placement.
Every worker runs its nodes in the graph's order, which excludes deadlocks.
"""

from palpate.engine import clock
from palpate.engine.schedule import nanoseconds, next_run
from palpate.engine.segment import CompiledSegment
from palpate.engine.slot import Input, NodeError, Slot
from palpate.engine.tick import run_tick
from palpate.launch.run.reports import Paused
from palpate.launch.run.work.worker import EndedError, Worker
from palpate.messages import Message

MOST = 1 << 16  # ticks in a block
BLOCK = 20_000_000  # [ns] time limit of a block of ticks, since Ctrl-C takes effect after it


def run_simulated(worker: Worker) -> None:
    """Run the ticks from 0 to the worker's last."""
    rate, pace, ticks = worker.job.rate, worker.job.pace, SimulatedClock(worker)
    lead = next((slot for slot in worker.slots if slot.node.paced), None)
    tick, begun = 0, clock.now()
    while worker.last is None or tick <= worker.last:
        if pace is not None and lead is not None:
            clock.sleep_until(worker.origin + round(nanoseconds(tick, rate) / pace))
        before, tick = tick, ticks.run(tick, 1 if pace is not None and lead is not None else MOST)
        count = tick - before
        if lead is not None:
            ended = clock.now()
            lead.health.age.add((ended - begun) // count, count)
            begun = ended
            if worker.stopping:
                _offer_the_end(worker, tick - 1)
            while not worker.agreed:
                worker.pause()


class SimulatedClock:
    """Runs the nodes of a worker on simulated time and waits for each input."""

    def __init__(self, worker: Worker) -> None:
        self.worker, self.rate, self.at = worker, worker.job.rate, 0
        self._block = 64  # ticks in a block of a segment without inputs

    def run(self, tick: int, most: int = 1) -> int:
        """Run up to `most` ticks in one block, as far as the nodes permit, then housekeeping. Returns the next tick."""
        worker = self.worker
        if most > 1 and worker.last is not None:
            most = max(1, min(worker.last - tick + 1, most))
        if worker.hop is not None:
            after = worker.hop.run(tick, tick + most, self)
            self.begins(after - 1)
        elif most > 1 and (part := alone(worker)) is not None:
            after, begun = tick + min(most, self._block), clock.now()
            self.begins(after - 1)
            part.run_many(tick, after - tick)
            self._block = max(16, self._block // 2) if clock.now() - begun > BLOCK else min(2 * self._block, MOST)
        else:
            after = tick + 1
            self.begins(tick)
            run_tick(worker.parts, tick, self)
        worker.housekeep(after - tick)
        return after

    def begins(self, tick: int) -> None:
        """Set the tick at which the nodes run."""
        self.worker.tick, self.at = tick, nanoseconds(tick, self.rate)

    def gather(self, slot: Slot, tick: int) -> list[Message | None] | None:
        """Wait for the messages of a step; None: the node was blocked meanwhile."""
        messages: list[Message | None] = [None] * len(slot.inputs)
        for place, port in slot.awaited:
            need = port.need(tick)
            if need >= 0 and not (port.dead or port.inside):
                messages[place] = port.of(need) or _await(self.worker, slot, port, need)
        return None if slot.blocked else messages

    def take_outputs(self, slot: Slot, tick: int) -> None:
        if slot.every > 1:
            slot.due = next_run(tick, slot.every)
        if tick >= slot.sends:
            self.worker.send(slot)


def alone(worker: Worker) -> CompiledSegment | None:
    """The segment of a worker without inputs that has no other nodes."""
    (part, *others) = worker.parts
    return part if not others and isinstance(part, CompiledSegment) and part.alone() else None


def _await(worker: Worker, slot: Slot, port: Input, need: int) -> Message | None:
    """Wait for the message of tick `need`; None: its sender has died, or the node is blocked."""
    assert port.feed is not None
    try:
        while True:
            came = worker.wait(port.feed)
            if (message := port.of(need)) is not None:
                return message
            if port.is_lost(need):
                raise NodeError(port.producer, f"stream {port.stream!r}", f"its message of tick {need} was lost")
            if came:
                continue
            if port.dead or slot.blocked:
                return None
            if worker.last is not None and worker.tick > worker.last:
                raise EndedError
            worker.awaits = port.stream, need
            # the sender may need a tick of another paced node, which waits for the end after an earlier one
            if worker.stopping and any(each.node.paced for each in worker.slots):
                _offer_the_end(worker, worker.tick)
    finally:
        worker.awaits = None


def _offer_the_end(worker: Worker, tick: int) -> None:
    """Report that the run may end after this tick. The launcher sets the last one: the largest of all paced workers."""
    worker.stopping = False
    if worker.bus is None:
        worker.last = tick
    else:
        worker.agreed = False
        worker.report(Paused(tick))
