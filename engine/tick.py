"""One tick of a graph: the only place where nodes are stepped, whoever runs them.

A run on either clock, a replay, `palpate.steps`, the test bus and the accuracy bench differ in where the inputs of a
node come from, in the time of a step and in what happens to its answers. Each is a `Host` that says so.
"""

from collections.abc import Iterable
from typing import Protocol, TypeVar

from palpate.engine.segment import Segment
from palpate.engine.slot import Slot
from palpate.messages import Message

S = TypeVar("S", bound=Slot, contravariant=True)


class Host(Protocol[S]):
    """What runs nodes.

    rate  [Hz] base rate
    at    [ns] time of the tick on the graph's clock; `gather` may set it anew for its node
    """

    rate: float
    at: int

    def gather(self, slot: S, tick: int) -> list[Message | None] | None:
        """The inputs of a step where the nodes of this process do not have them ready; None: the node does not step."""

    def sent(self, slot: S, tick: int) -> None:
        """Take the answers of a node, which are in its outputs."""


def run_tick(parts: Iterable[S | Segment], tick: int, host: Host[S]) -> None:
    """Step the nodes that are due at a tick, in their order: one by one, or as a segment. NodeError: one failed."""
    rate = host.rate
    for slot in parts:
        if isinstance(slot, Segment):
            slot.run(tick, host)
            continue
        if tick < slot.due or slot.blocked:
            continue
        messages = slot.ready(tick) if slot.near else None
        if messages is None:
            messages = host.gather(slot, tick)
            if messages is None:
                continue
        driving = messages[0] if slot.follows else None
        slot.step(tick, host.at if driving is None else driving.time, messages, slot.every / rate)
        host.sent(slot, tick)
