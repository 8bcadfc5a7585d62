"""Recording: every stream is a channel of an MCAP file with the unchanged wire bytes."""

import contextlib
import errno
import json
import time
import typing
from collections import deque
from functools import partial
from pathlib import Path
from typing import IO, Annotated, Any

import msgspec
import numpy as np

from palpate.messages import Health, Message, fields
from palpate.messages.base import HEADER
from palpate.nodes.base import Block, Observer, SettingError, Stream
from palpate.nodes.base.block import MARGIN
from palpate.records.format.head import PROFILE, SCHEMA_VERSION, Compression, head_alone
from palpate.records.format.message_head import HEAD, HEAD_LENGTH

LATEST = 1024  # runs of ticks of a stream, which separate the messages of a restarted node from earlier ones
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class _Time(msgspec.Struct, gc=False):
    time: int


_TIME = msgspec.msgpack.Decoder(_Time)
CHECK = 0.2  # [s] between the recorded messages of a stream that can be recomputed


class RecordedStream:
    """One recorded stream.

    channel   its number in the file
    every     ticks between expected messages
    keep      ticks between written messages
    skip      ticks between received messages on the simulated clock; 1: all
    heads     whether to write the heads of the other messages
    next      tick of the next expected message
    due       tick from which on a message is written
    first     tick of its first message
    received  number of received messages
    count     number of written messages
    gaps      number of missing messages between received ones
    runs      first tick of the last runs without a gap, and number of messages before each
    """

    __slots__ = (
        "channel", "count", "due", "every", "first", "gaps", "heads", "keep", "next", "received", "runs", "skip",
    )  # fmt: skip

    def __init__(self, channel: int, every: int, thin: int, simulated: bool, heads: bool) -> None:
        self.channel, self.heads = channel, heads
        self.keep = every * thin if thin > 1 else 1
        self.skip = self.keep if simulated else 1
        self.every = every * thin if simulated else every
        self.next = self.due = self.first = self.received = self.count = self.gaps = 0
        self.runs: deque[tuple[int, int]] = deque(maxlen=LATEST)

    def take(self, tick: int) -> bool:
        """Count a message. Returns whether to write it."""
        if self.skip > 1 and tick % self.skip:
            return False
        if tick != self.next or not self.received:
            self.gaps += max(0, (tick - self.next) // self.every)
            self.runs.append((tick, self.received))
        self.next = tick + self.every
        self.first = self.first if self.received else tick
        self.received += 1
        if self.keep > 1:
            if tick < self.due:
                return False
            self.due = tick - tick % self.keep + self.keep  # also if the clock skipped the tick `due`
        self.count += 1
        return True

    def take_all(self, ticks: np.ndarray) -> np.ndarray | bool:
        """Count messages of these ascending ticks. Returns which of them to write."""
        begin, end = int(ticks[0]), int(ticks[-1]) + self.every
        if self.keep == 1 and self.received and begin == self.next and end - begin == self.every * len(ticks):
            self.next = end  # none is missing
            self.received += len(ticks)
            self.count += len(ticks)
            return True
        return np.array([self.take(tick) for tick in ticks.tolist()])

    def count_before(self, tick: int) -> int | None:
        """Number of messages before a tick, which ascend; None: unknown, as the runs do not reach back to it."""
        if not self.runs or self.runs[0][0] >= tick:
            return None
        after = self.received
        for first, before in reversed(self.runs):
            if first < tick:
                return min(before - (first - tick) // self.every, after)
            after = before
        return None


class Mcap(Observer):
    """Writes the streams to an MCAP file: channels with units in their schemas, and the run's provenance.

    The file contains the number of lost messages per stream: those that the node sent but the logger did not receive.
    If the disk is full, the recording ends with a note, and the run continues; the file can be read up to its last
    chunk. The same is true of the file of a killed run.
    """

    effect = "recording"

    path: Annotated[str, "1"] = "palpate.mcap"
    thin: Annotated[dict[str, int], "1"] = {}  # Streams to thin out: name and n, to keep each n-th message
    leave_out: Annotated[tuple[str, ...], "1"] = ()
    """Streams that are not recorded."""
    within: Annotated[float, "s", msgspec.Meta(ge=0.0, le=60.0)] = 0.2
    """Longest time until a received message is in the file. If all processes are killed, messages of this time and
    those on the way to the logger are lost: 0.7 to 1.3 s in measurements with paced simulated time."""
    fields: Annotated[tuple[str, ...] | typing.Literal["all"], "1"] = ()
    """Fields to compute for the recording in addition to those that other nodes read."""
    compression: Annotated[Compression, "1"] = "zstd"
    sources: Annotated[tuple[str, ...], "1"] = ()
    """Streams from which all others can be recomputed. Of the others, one message per 0.2 s is recorded as a check, and
    on the real clock the heads of all, which contain the inputs of each step. (): record all messages."""

    def start(self) -> None:
        for name, keep in self.thin.items():
            if keep < 1:
                raise SettingError(f"thin: {name}: found {keep}, expected to keep each n-th message, n from 1")
        from palpate.records.format.attached import attach_files
        from palpate.records.format.mcap_writer import McapWriter

        self._recorded: dict[str, RecordedStream] = {}
        self._steps: dict[str, int] = {}
        self._times: dict[str, dict[str, float]] = {}
        self._since: dict[str, int] = {}
        self._before: dict[str, int] = {}
        self._notes = []
        self._file: IO[bytes] | None = None
        Path(self.path).parent.mkdir(parents=True, exist_ok=True)
        self._file = open(self.path, "wb")  # noqa: SIM115 - lives until stop
        self._writer = McapWriter(self._file, PROFILE, self.compression)
        self._writer.add_metadata("palpate.about", {k: json.dumps(v) for k, v in self.about.items()})
        attach_files(self._writer, self.about.get("files", {}))
        simulated = self.about.get("clock") == "simulated"
        check = round(CHECK * self.about.get("plan", {}).get("rate", 1000.0))
        schemas: dict[type, int] = {}
        for stream in self.streams:
            if stream.name in self.leave_out:
                continue
            if stream.type not in schemas:
                text = json.dumps(schema(stream.type)).encode()
                schemas[stream.type] = self._writer.add_schema(stream.type.__name__, text)
            thin = self.thin.get(stream.name, 1)
            about = {"producer": stream.producer, "every": str(stream.every)}
            heads = False
            if self.sources and stream.name not in self.sources:
                thin, heads = max(1, check // stream.every), not simulated
                about["kept"] = "heads" if heads else "checks"
            channel = self._writer.add_channel(
                stream.name, "msgpack", schemas[stream.type], {**about, "thin": str(thin)}
            )
            self._recorded[stream.name] = RecordedStream(channel, stream.every, thin, simulated, heads)
        self._due = time.monotonic() + self.within
        self._live = not simulated

    def period(self, stream: str) -> int:
        recorded = self._recorded.get(stream)
        return recorded.skip if recorded is not None else 0

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        recorded = self._recorded.get(stream)
        if recorded is None or self._behind():
            return
        if not recorded.take(tick):
            if not recorded.heads:
                return
            recorded.count += 1
            payload = head_alone(payload)
        at = _TIME.decode(payload).time
        try:
            self._writer.add_message(recorded.channel, tick, at if at > 0 else 0, payload)
            if time.monotonic() > self._due:
                self._on_time()
        except OSError as error:
            self._give_up(error)

    def observe_block(self, block: Block) -> None:
        recorded = [self._recorded.get(stream) for stream in block.streams]
        if type(self).observe is not Mcap.observe or any(one is not None and one.heads for one in recorded):
            super().observe_block(block)
            return
        if self._file is None or self._behind():  # the disk is full
            return
        # Select the messages to write. The thread of the writer makes their records, in the memory of the block.
        entries = block.entries
        kept, number = None, entries["number"].astype(np.uint16)
        rows, counts = np.argsort(number, kind="stable"), np.bincount(number, minlength=len(recorded))
        ticks, ends = entries["tick"][rows], np.cumsum(counts).tolist()
        for one, begin, end in zip(recorded, [0, *ends], ends, strict=False):
            taken = begin == end or (one is not None and one.take_all(ticks[begin:end]))
            if taken is not True:
                kept = np.ones(len(entries), bool) if kept is None else kept
                kept[rows[begin:end]] = taken
        try:
            if kept is None or kept.any():
                self._add(block, [one.channel if one else 0 for one in recorded], kept)
            if time.monotonic() > self._due:
                self._on_time()
        except OSError as error:
            self._give_up(error)

    def _add(self, block: Block, channels: list[int], kept: np.ndarray | None) -> None:
        """Pass the messages `kept` (n) of a block to the writer, without a copy of a long block; None: all messages."""
        entries = block.entries
        written = entries if kept is None else entries[kept]
        begin, end = int(written["begin"][0]) - MARGIN, int(written["end"][-1])
        memory = block.memory[begin:end]
        if 2 * len(memory) < len(block.memory) or not block.claim():  # a short block would waste the rest
            memory, entries = memory.copy(), entries.copy()
        given = kept, np.array(channels), entries, memory, begin
        self._writer.add_block(partial(_records, *given), len(memory))

    def _behind(self) -> bool:
        """Whether the disk is too slow, so that messages are dropped: on the real clock no tick waits for the disk."""
        try:
            return self._live and self._writer.full
        except OSError as error:  # of an earlier chunk
            self._give_up(error)
            return True

    def _on_time(self) -> None:
        """Write the received messages to the file; with `within` = 0 also flush it."""
        self._writer.close_chunk()
        if not self.within:
            self._writer.flush()
        self._due = time.monotonic() + self.within

    def health(self, message: Health) -> None:
        node = message.source
        since = self._since.get(node, 0)
        if message.since < since:
            return  # a late message of a dead predecessor
        if message.since > since:
            self._since[node] = message.since
            self._record_restart(node, message.since, message.steps)
        self._steps[node] = message.steps
        if message.median > 0.0:  # not in a replay
            self._times[node] = {"steps": message.steps, "median": message.median, "p99": message.p99}

    def _record_restart(self, node: str, since: int, steps: int) -> None:
        """Record the tick `since` at which a node restarted with a new state, so that a replay restarts it there; or
        that it began there, later than the run, so that its forces begin at zero in a replay too.

        Messages of the restarted node may arrive before its health, which takes another path. Their number is counted
        by the stored ticks or, if these do not reach back to `since`, is `steps`.
        """
        streams = [stream.name for stream in self.streams if stream.producer == node]
        every = [self._recorded[name] for name in streams if name in self._recorded]
        known = [one for one in every if one.received and one.first < since]  # others had no predecessor
        received = ((one.count_before(since), one.received - steps) for one in known)
        before = max((max(1, rest) if found is None else found for found, rest in received), default=0)
        # a recording that began later than the node contains less messages than it had steps
        late = not known and steps <= max((one.received for one in every), default=0)
        if self._file is None or (not late and before <= self._before.get(node, 0)):
            return
        self._before[node] = before  # the last lost messages of the predecessor cannot be counted
        try:
            self._writer.add_metadata(f"palpate.{'late' if late else 'restarted'}", {"node": node, "tick": str(since)})
        except OSError as error:
            self._give_up(error)

    def count_lost(self, stream: Stream) -> int:
        """Number of messages of a stream that were sent but not received.

        If the sender has not reported its number of steps, this is the number of ticks without a message.
        """
        steps = self._steps.get(stream.producer)
        if steps is None:
            return self._recorded[stream.name].gaps
        recorded, since = self._recorded[stream.name], self._since.get(stream.producer, 0)
        if recorded.skip > 1:  # number of the steps since then at ticks that the logger receives
            steps = -(-(since + steps * stream.every) // recorded.skip) + (-since // recorded.skip)
        return max(0, self._before.get(stream.producer, 0) + steps - recorded.received)

    def _give_up(self, error: OSError) -> None:
        file, self._file = self._file, None
        assert file is not None
        self._recorded = {}  # no further messages
        why = "the disk is full" if error.errno in _FULL else error.strerror
        self._notes.append(f"recording {self.path} ends here: {why}; the messages before it can be read")
        self._writer.close()
        with contextlib.suppress(OSError):  # its buffer cannot be written either
            file.close()

    def stop(self) -> None:
        if "_file" not in self.__dict__ or self._file is None:  # it never started, or has stopped
            return
        try:
            known = [stream for stream in self.streams if stream.name in self._recorded]
            counts = {s.name: {"count": self._recorded[s.name].count, "lost": self.count_lost(s)} for s in known}
            for name, about in (("palpate.counts", counts), ("palpate.times", self._times)):
                self._writer.add_metadata(name, {key: json.dumps(value) for key, value in about.items()})
            self._writer.finish()
            self._file.close()
        except OSError as error:
            self._give_up(error)
            return
        self._file = None
        lost = {name: value["lost"] for name, value in counts.items() if value["lost"]}
        if lost:
            losses = ", ".join(f"{name} {number}" for name, number in lost.items())
            self._notes.append(f"recording {self.path} lacks messages that did not reach it in time: {losses}")


def _records(
    kept: np.ndarray | None, channels: np.ndarray, entries: np.ndarray, memory: np.ndarray, at: int
) -> tuple[Any, ...]:
    """A piece for the writer: heads, and records with these heads, of the messages `kept` (n) of a block, whose
    `memory` begins at `at`; None: of all messages."""
    # Set the channels in the heads of the records.
    written = entries if kept is None else entries[kept]
    heads = np.zeros(len(written), HEAD)
    heads["length"] = written["end"] - written["begin"] + HEAD_LENGTH
    heads["channel"], heads["time"] = channels[written["number"]], np.maximum(written["time"], 0)
    begins, ends = written["begin"] - at - MARGIN, written["end"] - at
    at_channel = HEAD.fields["channel"][1]  # type: ignore[index]
    places = np.ndarray(len(memory) - MARGIN + 1, "<u2", memory, at_channel, strides=(1,))
    places[begins] = heads["channel"]
    # Pass each run of consecutive messages as one piece.
    breaks = np.flatnonzero(begins[1:] != ends[:-1])
    first, last = np.concatenate(([0], breaks + 1)), np.concatenate((breaks, [-1]))
    return heads.data.cast("B"), *(memory.data[b:e] for b, e in zip(begins[first], ends[last], strict=True))


def schema(kind: type[Message]) -> dict[str, Any]:
    """JSON schema of a message type, with unit, shape and dtype on each field."""
    names: dict[type, str] = {float: "number", int: "integer", bool: "boolean", str: "string"}
    properties: dict[str, Any] = {name: {"type": "integer"} for name in HEADER[:2]}
    properties["source"] = {"type": "string"}
    properties["used"] = {"type": "array", "items": {"type": "integer"}}
    properties["delayed"] = {"type": "integer"}
    for field in fields(kind):
        entry: dict[str, Any] = {"unit": field.unit, "shape": list(field.shape)}
        if field.dtype is not None:
            entry |= {"type": "object", "dtype": field.dtype.str}
        elif field.shape:
            entry |= {"type": "array", "items": {"type": "number"}}
        else:
            entry["type"] = names.get(field.type, "string")
        properties[field.name] = entry
    about = (kind.__doc__ or "").partition("\n")[0]
    return {
        "title": kind.__name__,
        "class": f"{kind.__module__}.{kind.__qualname__}",
        "version": SCHEMA_VERSION,
        "description": about,
        "type": "object",
        "properties": properties,
    }
