"""The health of the nodes of a worker, which it sends to launcher and observers."""

from collections.abc import Iterator
from typing import Any

from palpate.engine import clock
from palpate.engine.health import Counters, message
from palpate.engine.segment import CompiledSegment
from palpate.engine.slot import Slot
from palpate.launch.run.reports import Alive
from palpate.launch.run.wire.bus import HEALTH, frame
from palpate.messages import Health, pack

REPORT = 200_000_000  # [ns] between two heartbeats
REPORTED, PARTS = 2, 12  # nodes in one part of a heartbeat, but more if this needs more parts: 0.3 s on the real clock


class Heartbeat:
    """The heartbeats of a `Worker`, sent as a whole or in parts."""

    def __init__(self, worker: Any) -> None:
        self._worker = worker
        self._sent = 0  # [ns] time of the last one
        self._rest: Iterator[None] | None = None  # of one that is sent in parts

    @property
    def begun(self) -> bool:
        """Whether parts of a heartbeat have not been sent yet."""
        return self._rest is not None

    def due(self, moment: int) -> bool:
        """Whether the last heartbeat is `REPORT` old at this moment [ns]."""
        return moment - self._sent > REPORT

    def send(self) -> None:
        """Send a heartbeat as a whole."""
        self._rest = None
        for _ in self._parts():
            pass

    def begin(self) -> None:
        """Begin a heartbeat whose parts `send_part` sends, unless one has begun. On the real clock each pause has one
        part, since the whole takes longer than a tick."""
        self._rest = self._rest or self._parts()

    def send_part(self) -> None:
        """Send the next part of the heartbeat that has begun."""
        if self._rest is not None and next(self._rest, self) is self:
            self._rest = None

    def _parts(self) -> Iterator[None]:
        """Send a heartbeat; each step sends a part."""
        worker = self._worker
        self._sent = clock.now()
        if worker.hop is not None:
            worker.hop.count()
        for part in worker.parts:
            if isinstance(part, CompiledSegment):
                part.count()
        nodes: dict[str, Counters] = {}
        share = max(REPORTED, -(-len(worker.slots) // PARTS))
        for k, slot in enumerate(worker.slots):
            if k % share == 0:
                yield
            slot.health.state = slot.node.condition() or "ready"
            nodes[slot.name] = slot.health.report(slot.forces())
            self.tell_observers(slot, nodes[slot.name])
        yield
        nodes |= {observer.name: observer.health.report() for observer in worker.audience.slots}
        worker.report(Alive(nodes, worker.awaits))
        yield
        worker.pass_notes()

    def tell_observers(self, slot: Slot, counters: Counters) -> None:
        """Send the health of a node to the observers of this worker and of others."""
        worker = self._worker
        far = worker.bus is not None and worker.bus.has_reader(HEALTH)
        if not far and not worker.audience.begun:
            return
        health = self.health(slot, counters)
        worker.audience.pass_health(health)
        if far:
            worker.bus.keep(frame(HEALTH, pack(health)))

    def health(self, slot: Slot, counters: Counters) -> Health:
        """The health of a node as a message."""
        last = slot.outputs[0].last if slot.outputs else None
        return message(slot.name, last.time if last is not None else 0, self._worker.since, counters)
