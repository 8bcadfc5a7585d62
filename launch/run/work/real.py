"""The loop on the real clock: the paced node keeps the time, the others run when their driving input arrives.

A node waits up to one period for inputs of the same tick from the force path, and holds the newest message of all
others; the header's `used` records which. A tick that could not begin within its period is left out and counted.

Inputs expire: after `HELD` without a new message (`RELEASED` for a paced node; three periods of the sender if longer)
an input is missing. Time in which the node itself did not step does not count, except for hardware. So at 1 kHz, less
than 20 ms after a node stops, its last messages no longer affect the device:

* Nodes that it drives stop at once, since a step needs a new driving message; one that several senders may drive goes
  on with the next of them (`Slot.hear`). The other nodes depend on it only through held inputs.
* A node for which the input is optional continues without it after `HELD` (no tissue: no force).
* A node for which the input is required stops after `HELD`, and its readers begin to hold its last message. All n
  required inputs of the graph share `HELD`: each is held for HELD / n (`Job.links`).
* The device holds the last torque for `RELEASED`: n (HELD / n) + RELEASED = 16 ms; then the torque ramps to zero in
  4 ms. If only an optional input is missing, the controller ramps the force down within 4 ms after `HELD`.

On an overloaded machine the same ages remove the torque: for hardware a delay above `RELEASED` is an outage, whereas a
simulated device was stopped together with the loop and continues with its last torque. After an outage the force ramps
up from zero (nodes/base/absence.py).
"""

from typing import Protocol

from palpate.engine import clock
from palpate.engine.job import Job
from palpate.engine.schedule import (
    FRESH,
    MISSED,
    OLD,
    begin_of,
    lacks,
    left_out,
    needed_tick,
    next_run,
    sender_stopped,
    slept,
    standing,
    unread,
)
from palpate.engine.slot import Input, RemoteStream, Slot
from palpate.engine.tick import run_tick
from palpate.launch.run.hop.hop import FAR, Hop
from palpate.launch.run.work.expiry import permitted_age
from palpate.launch.run.work.worker import EndedError, Worker
from palpate.messages import Message

WAITED = 1.5  # periods after the last tick for which one of several drivers is waited for: readers hold its messages
AGAIN = 1_000_000  # [ns] between looks whether one of several drivers has sent a message


def run_real(worker: Worker) -> None:
    """Run until the worker's last tick or until it is stopped."""
    paced = next((slot for slot in worker.slots if slot.node.paced), None)
    lead = paced or worker.slots[0]
    ticks = _RealClock(worker, lead)
    while worker.last is None or worker.tick < worker.last:
        if worker.hop is not None and ticks.hop(worker.hop):
            continue
        started = _pace(worker, lead, 1e9 / ticks.rate) if paced else _follow(worker, lead, ticks.patience())
        if started is not None:
            ticks.run(*started)


class _RealClock:
    """Runs the nodes of a worker in real time. `lead`: the node whose input or clock starts a tick."""

    def __init__(self, worker: Worker, lead: Slot) -> None:
        self.worker, self.lead, self.rate = worker, lead, worker.job.rate
        self.period = round(1e9 / self.rate)
        self.at = self.deadline = 0

    def run(self, tick: int, at: int) -> None:
        """Run the nodes that step at this tick, then orders and housekeeping."""
        worker = self.worker
        self.begins(tick, at, clock.now())
        run_tick(worker.parts, tick, self)
        worker.check_orders()
        worker.housekeep()

    def begins(self, tick: int, at: int, begun: int) -> None:
        """Set the tick at which the nodes run, its time [ns], and when they began [ns of the monotonic clock]."""
        self.worker.tick, self.at, self.deadline = tick, at, begun + self.period

    def patience(self) -> int | None:
        """The time [ns of the monotonic clock] after which another driver of the lead replaces one that is silent;
        None: it has no other."""
        begun = self.deadline - self.period
        return begun + round(WAITED * self.period * self.lead.inputs[0].every) if self.lead.drivers else None

    def hop(self, hop: Hop) -> bool:
        """Run some ticks in compiled code, then orders and housekeeping. False: none is ready to run there."""
        worker = self.worker
        if self.lead.drivers and self.lead.driver is not self.lead.inputs[0]:
            return False  # compiled code waits for the first one
        ticks = hop.run_real(self, self.worker.origin, self.lead, self.patience())
        if ticks:
            worker.listen()
            worker.check_orders()
            worker.housekeep(ticks)
            if worker.stopping:
                raise EndedError
        return ticks > 0

    def gather(self, slot: Slot, tick: int) -> list[Message | None] | None:
        """The inputs of a step, see `take_inputs`. A node that lacks one retries at the next tick; each run of its
        divisor is counted as lost once."""
        messages = take_inputs(self.worker, slot, tick, self.deadline, slot is self.lead)
        if messages is None:
            slot.health.lost += tick // slot.every != slot.missed
            slot.missed = tick // slot.every
        return messages

    def take_outputs(self, slot: Slot, tick: int) -> None:
        """Send the outputs, and record their latency."""
        slot.due = next_run(tick, slot.every)
        self.worker.send(slot)
        age = max(0, clock.now() - self.worker.origin - self.at)
        slot.health.age.add(age)
        slot.health.overdue += age > self.period


class Waiting(Protocol):
    """What the inputs of a step need of their worker."""

    job: Job
    stopping: bool

    def now(self) -> int:
        """The time of the machine [ns]."""
        ...

    def wait(self, feed: RemoteStream, deadline: int | None = None) -> object:
        """Wait for messages of another worker, until the deadline [ns]."""
        ...


def _pace(worker: Worker, lead: Slot, period: float) -> tuple[int, int] | None:
    """Wait for the next tick of the clock; returns tick and time. Ticks whose whole period has passed are left out,
    except the last one of the run."""
    tick = worker.tick + 1
    late = clock.sleep_until(worker.origin + begin_of(tick, period))
    skipped = left_out(late, period, tick, FAR if worker.last is None else worker.last)
    if worker.tick >= 0:  # a restarted worker begins at the current tick
        lead.health.late += skipped
    if worker.stopping:
        raise EndedError
    worker.drain()
    return tick + skipped, clock.now() - worker.origin


def _follow(worker: Worker, lead: Slot, until: int | None) -> tuple[int, int] | None:
    """Wait for the next driving message and use the newest. Skipped messages for a run of the node's divisor count as
    lost; messages between two runs do not. From the time `until` [ns] on, another driver replaces a silent one."""
    while True:
        lead.hear(worker.tick, until is not None and worker.now() >= until)
        port = lead.driver or lead.inputs[0]
        if port.queue and not (port.dead or lead.blocked):
            break
        if port.feed is None or port.dead:
            worker.pause()
        else:
            worker.wait(port.feed, None if until is None or lead.blocked else max(until, worker.now() + AGAIN))
            if lead.blocked or until is not None:  # its input still arrives, so `wait` alone would not poll the sockets
                worker.drain()
            worker.check_orders()
        if worker.stopping:
            raise EndedError
    worker.drain()
    newest = port.queue[-1]
    lead.health.lost += unread(_runs(lead, port), newest.tick, lead.due, worker.tick)
    if newest.tick <= worker.tick:
        port.queue.clear()
        return None
    return newest.tick, newest.time


def _runs(slot: Slot, port: Input) -> int:
    """Number of runs of the node's divisor for which messages wait; ticks of one period belong to the same run."""
    return len({message.tick // slot.every for message in port.queue if message.tick >= slot.due})


def take_inputs(worker: Waiting, slot: Slot, tick: int, deadline: int, leading: bool) -> list[Message | None] | None:
    """The inputs of a step; None if a required one did not arrive in time. For a node of a segment all messages that
    have arrived: compiled code applies the same rules to them."""
    messages: list[Message | None] = []
    without = False  # a required input is missing, so waiting for others is useless
    for port in slot.inputs:
        if port.inside:
            messages.append(None)
            continue
        drives = slot.drives(port)
        waits = (port.waits or drives) and not (leading and drives) and not port.quiet
        waits = waits and not _silent(worker, slot, port, tick)
        message = _pick(worker, port, tick, deadline, waits and not without)
        state = OLD if message is None else _stands(worker, slot, port, message, tick)
        without = without or lacks(state, port.port.optional)
        if not slot.joined:
            if without:
                slot.health.held += message is not None and state not in (FRESH, MISSED)
                return None
            if message is not None:
                slot.health.held += state != FRESH
                slot.health.absent += state == OLD
            message = message if state != OLD else None
        messages.append(message)
    return messages


def _silent(worker: Waiting, slot: Slot, port: Input, tick: int) -> bool:
    """Whether the sender of an optional input has stopped, so that waiting for it is useless."""
    if not port.port.optional or port.dead:
        return False
    message = port.newest(tick - 1 if port.loop else tick)
    return message is not None and sender_stopped(_stands(worker, slot, port, message, tick), True)


def _stands(worker: Waiting, slot: Slot, port: Input, message: Message, tick: int) -> int:
    """How a step takes a message, see `engine.schedule`."""
    need, age = (
        needed_tick(tick, port.every, port.loop),
        tick - message.tick - slept(tick, slot.due, slot.node.hardware),
    )
    permits = permitted_age(worker.job, slot, port)
    return standing(message.tick, need, slot.drives(port), age, worker.job.rate, permits)


def _pick(worker: Waiting, port: Input, tick: int, deadline: int, waits: bool) -> Message | None:
    """The message of this tick, if it arrives before the deadline; otherwise the newest one before it."""
    if port.dead:
        return None
    message = port.newest(tick - 1 if port.loop else tick)
    need = needed_tick(tick, port.every, port.loop)
    if not waits or port.loop or port.output is not None:
        return message
    while (message is None or message.tick < need) and not port.is_lost(need) and worker.now() < deadline:
        assert port.feed is not None
        worker.wait(port.feed, deadline)
        if port.dead or worker.stopping:
            return None
        message = port.newest(tick)
    return message
