"""Inputs without new messages: up to which age they are held on the real clock, and the inputs from dead nodes."""

from collections.abc import Iterable

from palpate.engine.job import Job
from palpate.engine.slot import Input, Slot

HELD = 0.007  # [s] age at which an input of a node on the real clock counts as absent
RELEASED = 0.009  # [s] age at which an input of a paced node counts as absent: the device is without torque


def permitted_age(job: Job, slot: Slot, port: Input) -> float:
    """The age [s] up to which an input is held on the real clock; `real` derives from it when the device stops."""
    period = port.every / job.rate
    age = max(RELEASED if slot.node.paced else HELD, 3 * period)
    chained = job.links > 1 and not (slot.node.paced or port.port.optional)
    return max(age / job.links, period) if chained else age


def absences(slot: Slot) -> str:
    """The note on steps without an optional input that had expired."""
    wired = [f"{port.port.name} of {port.producer}" for port in slot.inputs if port.port.optional and port.stream]
    return (
        f"optional inputs ({', '.join(wired)}) were absent in {slot.health.absent} steps of {slot.name}, because their"
        " last message was too old: the sender was silent, or the machine stalled"
    )


def end_inputs(slots: Iterable[Slot], nodes: set[str], blocked: set[str], back: bool) -> None:
    """End the inputs from dead nodes, or resume those of restarted ones; block or unblock nodes that need them."""
    for slot in slots:
        if slot.name in blocked:
            slot.blocked = not back
        for port in slot.inputs:
            if port.producer in nodes | blocked:
                port.dead = not back
                port.queue.clear()
                port.message = None
