"""One tick of a graph: the only code that steps nodes.

Runs on both clocks, replays, `palpate.steps`, the test bus and the accuracy bench differ in the source of a node's
inputs, in the time of a step and in the use of its outputs. Each of them implements `Host`.
"""

from collections.abc import Iterable
from typing import Protocol, TypeVar

from palpate.engine.segment import CompiledSegment
from palpate.engine.slot import Slot
from palpate.messages import Message

S = TypeVar("S", bound=Slot, contravariant=True)


class Host(Protocol[S]):
    """Environment in which nodes are stepped.

    rate  [Hz] base rate
    at    [ns] time of the tick on the graph's clock; `gather` may change it for its node
    """

    rate: float
    at: int

    def gather(self, slot: S, tick: int) -> list[Message | None] | None:
        """The inputs of a step that are not available in this process; None: the node does not step."""

    def take_outputs(self, slot: S, tick: int) -> None:
        """Handle the outputs of a node after its step."""


def run_tick(parts: Iterable[S | CompiledSegment], tick: int, host: Host[S]) -> None:
    """Step the nodes that are due at a tick, in order, one by one or as a segment. NodeError: a node failed."""
    rate = host.rate
    for slot in parts:
        if isinstance(slot, CompiledSegment):
            slot.run(tick, host)
            continue
        if tick < slot.due or slot.blocked:
            continue
        messages = slot.ready(tick) if slot.near else None
        if messages is None:
            messages = host.gather(slot, tick)
            if messages is None:
                continue
        slot.step(tick, slot.time_of(messages, host.at), messages, slot.every / rate)
        host.take_outputs(slot, tick)
