"""The loop on the simulated clock: as fast as the machine allows, or paced.

Each node waits for exactly the messages that the rules of `schedule` name, so that the answer does not depend on the
placement. Every worker runs its nodes in the graph's order, which excludes deadlock.
"""

from palpate.engine.clock import now, sleep_until
from palpate.engine.schedule import nanoseconds, next_run
from palpate.engine.slot import Input, NodeError, Slot
from palpate.engine.tick import run_tick
from palpate.launch.run.reports import Paused
from palpate.launch.run.work.worker import EndedError, Worker
from palpate.messages import Message


def run_simulated(worker: Worker, origin: int) -> None:
    """Run the ticks from 0 to the worker's last. `origin` [ns]: when tick 0 is, where the run is paced."""
    rate, pace, clock = worker.job.rate, worker.job.pace, SimulatedClock(worker)
    lead = next((slot for slot in worker.slots if slot.node.paced), None)
    tick, begun = 0, now()
    while worker.last is None or tick <= worker.last:
        if pace is not None and lead is not None:
            sleep_until(origin + round(nanoseconds(tick, rate) / pace))
        clock.run(tick)
        if lead is not None:
            ended = now()
            lead.health.age.add(ended - begun)
            begun = ended
            if worker.stopping:
                _agree_on_the_end(worker, tick)
        tick += 1


class SimulatedClock:
    """Runs the nodes of a worker on simulated time: each input is waited for."""

    def __init__(self, worker: Worker) -> None:
        self.worker, self.rate, self.at = worker, worker.job.rate, 0

    def run(self, tick: int) -> None:
        """Run the nodes that step at this tick, and what is due after it."""
        self.worker.tick = tick
        self.at = nanoseconds(tick, self.rate)
        run_tick(self.worker.slots, tick, self)
        self.worker.housekeep()

    def gather(self, slot: Slot, tick: int) -> list[Message | None] | None:
        """The messages that a step uses, each waited for; None: the node has been blocked meanwhile."""
        messages: list[Message | None] = [None] * len(slot.inputs)
        for place, port in slot.awaited:
            need = port.need(tick)
            if need >= 0 and not port.dead:
                messages[place] = port.of(need) or _await(self.worker, slot, port, need)
        return None if slot.blocked else messages

    def sent(self, slot: Slot, tick: int) -> None:
        """Send the answers that somebody takes."""
        if slot.every > 1:
            slot.due = next_run(tick, slot.every)
        if tick >= slot.sends:
            self.worker.send(slot)


def _await(worker: Worker, slot: Slot, port: Input, need: int) -> Message | None:
    """The message of tick `need`; None where its sender is gone, or the node is not to step."""
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
    """Every paced worker tells where it is and waits; the launcher names the last tick, the largest of these."""
    worker.stopping = False
    worker.last = tick if worker.bus is None else None
    worker.report(Paused(tick))
    while worker.last is None:
        worker.pause()
