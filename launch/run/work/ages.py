"""Ages up to which inputs are held on the real clock; `real` derives the time until the device stops from them."""

from palpate.engine.job import Job
from palpate.engine.slot import Input, Slot

HELD = 0.007  # [s] age at which an input of a node counts as absent
RELEASED = 0.009  # [s] age at which an input of a paced node counts as absent: the device is without torque


def permitted(job: Job, slot: Slot, port: Input) -> float:
    """The age [s] up to which an input is held."""
    period = port.every / job.rate
    age = max(RELEASED if slot.node.paced else HELD, 3 * period)
    chained = job.links > 1 and not (slot.node.paced or port.port.optional)
    return max(age / job.links, period) if chained else age
