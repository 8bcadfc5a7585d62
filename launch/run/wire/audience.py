"""The observers of one worker (loggers, viewers): they receive encoded messages and the health of the nodes."""

from collections.abc import Callable

import msgspec

from palpate.engine.imports import load_class
from palpate.engine.job import Job
from palpate.engine.schedule import needed_tick
from palpate.engine.slot import NodeError, ObserverSlot, Output, make
from palpate.launch.run.hop.blocks import block_of
from palpate.launch.run.wire.bus import END, HEALTH
from palpate.messages import Health, Message, MessageError, unpack
from palpate.nodes.base import Block, Observer, Stream

FINAL = msgspec.msgpack.Decoder(list[bytes])


class Audience:
    """The observers of a worker.

    leave  called with each group that sent its end-of-stream marker; that group waits until no observer is connected
    """

    def __init__(self, job: Job, leave: Callable[[str], None] | None) -> None:
        self.job, self._leave = job, leave
        self.slots: list[ObserverSlot] = []
        for given in job.observers:
            node = make(given)
            if not isinstance(node, Observer):
                raise NodeError(given.name, "use", f"{given.cls} is not an observer")
            self.slots.append(ObserverSlot(given, node))
        self.begun: list[ObserverSlot] = []
        self.ended: set[str] = set()  # groups that sent their end-of-stream marker
        self.lost: set[str] = set()  # groups that ended without one

    def start(self, slot: ObserverSlot, outputs: dict[str, Output]) -> None:
        """Start one observer; `outputs`: the outputs of this worker, by stream. NodeError: it raised."""
        streams = tuple(
            Stream(stream, load_class(given.type, Message), given.producer, given.every)
            for stream, given in slot.streams.items()
        )
        try:
            slot.node.listen(streams, self.job.about)
            slot.node.start()
        except BaseException as error:
            raise NodeError(slot.name, "start", error) from error
        self.begun.append(slot)
        for stream in slot.streams:
            if stream in outputs:
                outputs[stream].listeners.append(slot)

    def handle_frame(self, data: bytes) -> int:
        """Handle a frame of another worker. Returns its tick, or -1 if it has none. NodeError: an observer raised."""
        topic, _, payload = data.partition(b"\0")
        stream = topic.decode(errors="replace")
        try:
            if stream == HEALTH:
                self.pass_health(unpack(payload, Health))
                return -1
            if stream == END:
                name, _, final = payload.partition(b"\0")
                for health in FINAL.decode(final) if final else ():
                    self.pass_health(unpack(health, Health))
                group = name.decode(errors="replace")
                self.ended.add(group)
                if self._leave is not None:
                    self._leave(group)
                return -1
            block = block_of(stream, payload)
            if block is not None:
                return self._hear_block(stream, block)
            tick = unpack(payload, Message).tick
        except (MessageError, msgspec.MsgspecError):  # not of this run
            return -1
        for slot in self.slots:
            if stream in slot.streams and tick > slot.last[stream]:
                slot.observe(stream, tick, payload)
        return tick

    def _hear_block(self, stream: str, block: Block) -> int:
        for slot in self.slots:
            if stream in slot.streams:
                entries = block.entries[block.entries["tick"] > slot.last[stream]]
                if len(entries):
                    slot.take_block(block._replace(entries=entries))
                    slot.take()
        return int(block.entries["tick"][-1])

    def pass_health(self, report: Health) -> None:
        for slot in self.begun:
            slot.node.health(report)

    def has_all(self, last: int | None) -> bool:
        """Whether the last message of every stream has arrived; unknown (False) on the real clock."""
        if last is None or self.job.clock == "real":
            return False
        return all(
            slot.last[stream] >= needed_tick(last, given.every, False)
            for slot in self.slots
            for stream, given in slot.streams.items()
        )
