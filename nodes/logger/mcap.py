"""Recording: every stream as a channel of an MCAP file, the wire bytes as they are."""

import contextlib
import errno
import json
import time
import typing
from collections import deque
from pathlib import Path
from typing import IO, Annotated, Any

import msgspec
import numpy as np
from mcap.opcode import Opcode

from palpate.messages import Health, Message, fields
from palpate.messages.base import HEADER
from palpate.nodes.base import Block, Observer, SettingError, Stream
from palpate.nodes.base.block import MARGIN
from palpate.records.format.head import PROFILE, SCHEMA_VERSION, head_alone
from palpate.records.format.mcap_writer import CHUNK_SIZE, HEAD, Compression, McapWriter

LATEST = 1024  # ticks of a stream by which a node's new life is told from the one before
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class _Time(msgspec.Struct, gc=False):
    time: int


_TIME = msgspec.msgpack.Decoder(_Time)
HEAD_LENGTH = HEAD.itemsize - 9  # [B] of a head, without kind and length of its record
CHECK = 0.2  # [s] between the messages that are kept of a stream that can be computed again


class _Recorded:
    """One recorded stream.

    channel  its number in the file
    every    ticks between two messages that are to come
    keep     ticks between two that are written
    skip     ticks between two that it takes, on the simulated clock; 1: it takes each
    heads    of messages that are not kept their heads are written
    next     tick at which its next message is expected; due: from which on one is written
    first    tick of its first message
    heard    messages that came; count: that were written; gaps: that are missing between those that came
    last     ticks of the last ones
    """

    __slots__ = ("channel", "count", "due", "every", "first", "gaps", "heads", "heard", "keep", "last", "next", "skip")

    def __init__(self, channel: int, every: int, thin: int, simulated: bool, heads: bool) -> None:
        self.channel, self.heads = channel, heads
        self.keep = every * thin if thin > 1 else 1
        self.skip = self.keep if simulated else 1
        self.every = every * thin if simulated else every
        self.next = self.due = self.first = self.heard = self.count = self.gaps = 0
        self.last: deque[int] = deque(maxlen=LATEST)

    def take(self, ticks: np.ndarray) -> np.ndarray:
        """Count messages of these ascending ticks, as `Mcap.observe` counts one. Returns which of them to write."""
        heard = np.full(len(ticks), True) if self.skip == 1 else ticks % self.skip == 0
        ticks = ticks[heard]
        if not len(ticks):
            return heard
        expected = np.concatenate(([self.next], ticks[:-1] + self.every))
        self.gaps += int(np.maximum(0, (ticks - expected) // self.every).sum())
        self.next = int(ticks[-1]) + self.every
        self.first = self.first if self.heard else int(ticks[0])
        self.heard += len(ticks)
        self.last.extend(ticks[-LATEST:].tolist())
        if self.keep > 1:
            period = ticks // self.keep
            heard[heard] = period > np.concatenate(([self.due // self.keep - 1], period[:-1]))
            self.due = max(self.due, int(period[-1] + 1) * self.keep)
        self.count += int(heard.sum())
        return heard


class Mcap(Observer):
    """Writes the streams to an MCAP file: channels with units in their schemas, and the run's provenance.

    What it did not get is counted in the file, per stream: messages that their node sent and that did not come. A full
    disk ends the recording with one line and leaves a file that opens up to its last chunk; the run goes on. A run that
    is killed leaves such a file, too.
    """

    effect = "recording"

    path: Annotated[str, "1"] = "palpate.mcap"
    thin: Annotated[dict[str, int], "1"] = {}  # Streams to thin out: name and n, to keep each n-th message
    leave_out: Annotated[tuple[str, ...], "1"] = ()
    """Streams not to record; those of nodes that do not run are not there anyway."""
    within: Annotated[float, "s", msgspec.Meta(ge=0.0, le=60.0)] = 0.2
    """What has come is in the file after this time at the latest. A kill of everything costs that, and what was still
    under way to the logger: 0.7 to 1.3 s in all were measured where simulated time is paced."""
    fields: Annotated[tuple[str, ...] | typing.Literal["all"], "1"] = ()
    """Of a stream that other nodes read too: fields to compute for the recording, beside those that are read."""
    compression: Annotated[Compression, "1"] = "zstd"
    sources: Annotated[tuple[str, ...], "1"] = ()
    """Streams from which all others can be computed again: of the others one message is kept every 0.2 s, as a check,
    and on the real clock the heads of all, which say what each step used. () keeps all messages."""

    def start(self) -> None:
        for name, keep in self.thin.items():
            if keep < 1:
                raise SettingError(f"thin: {name}: found {keep}, expected to keep each n-th message, n from 1")
        self._recorded: dict[str, _Recorded] = {}
        self._steps: dict[str, int] = {}
        self._times: dict[str, dict[str, float]] = {}
        self._since: dict[str, int] = {}
        self._before: dict[str, int] = {}
        self._notes = []
        self._file: IO[bytes] | None = None
        Path(self.path).parent.mkdir(parents=True, exist_ok=True)
        self._file = open(self.path, "wb", buffering=CHUNK_SIZE)  # noqa: SIM115 - lives until stop
        self._writer = McapWriter(self._file, PROFILE, self.compression)
        self._writer.add_metadata("palpate.about", {k: json.dumps(v) for k, v in self.about.items()})
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
            self._recorded[stream.name] = _Recorded(channel, stream.every, thin, simulated, heads)
        self._due = time.monotonic() + self.within
        self._live = not simulated

    def period(self, stream: str) -> int:
        own = self._recorded.get(stream)
        return own.skip if own is not None else 0

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        own = self._recorded.get(stream)
        if own is None or (own.skip > 1 and tick % own.skip) or self._behind():
            return
        if tick != own.next:
            own.gaps += max(0, (tick - own.next) // own.every)
        own.next = tick + own.every
        own.heard += 1
        if own.heard == 1:
            own.first = tick
        own.last.append(tick)
        if own.keep > 1:
            if tick >= own.due:
                own.due = tick - tick % own.keep + own.keep  # also where the clock left out the very tick
            elif own.heads:
                payload = head_alone(payload)
            else:
                return
        at = _TIME.decode(payload).time
        try:
            self._writer.add_message(own.channel, tick, at if at > 0 else 0, payload)
            own.count += 1
            if time.monotonic() > self._due:
                self._on_time()
        except OSError as error:
            self._give_up(error)

    def observe_block(self, block: Block) -> None:
        recorded = [self._recorded.get(stream) for stream in block.streams]
        if type(self).observe is not Mcap.observe or any(own is not None and own.heads for own in recorded):
            super().observe_block(block)
            return
        if self._behind():
            return
        # Select the messages to write and fill in their heads.
        number, kept = block.entries["number"], np.zeros(len(block.entries), bool)
        for place, own in enumerate(recorded):
            if own is not None and len(rows := np.flatnonzero(number == place)):
                kept[rows] = own.take(block.entries["tick"][rows])
        entries = block.entries[kept]
        heads = np.zeros(len(entries), HEAD)
        heads["kind"], heads["length"] = Opcode.MESSAGE, entries["end"] - entries["begin"] + HEAD_LENGTH
        heads["channel"] = np.array([own.channel if own else 0 for own in recorded])[entries["number"]]
        heads["tick"] = entries["tick"]
        heads["time"] = heads["at"] = np.maximum(entries["time"], 0)
        place = entries["begin"][:, None] - MARGIN + np.arange(MARGIN)
        block.memory[place] = heads.view(np.uint8).reshape(-1, MARGIN)
        # Pass each run of consecutive messages as one piece.
        ends = np.flatnonzero(np.diff(np.flatnonzero(kept), append=-1) != 1)
        begins = np.concatenate(([0], ends[:-1] + 1))
        memory = block.memory.data
        pieces = zip((entries["begin"][begins] - MARGIN).tolist(), entries["end"][ends].tolist(), strict=True)
        try:
            if len(entries):
                self._writer.add_block(heads, b"".join(memory[begin:end] for begin, end in pieces))
            if time.monotonic() > self._due:
                self._on_time()
        except OSError as error:
            self._give_up(error)

    def _behind(self) -> bool:
        """Whether the disk is so slow that a message on the real clock is lost, because no tick waits for the disk."""
        return self._live and self._writer.full

    def _on_time(self) -> None:
        """What has come goes into the file; with no time to wait it is there at once."""
        self._writer.close_chunk()
        if not self.within:
            self._writer.flush()
        self._due = time.monotonic() + self.within

    def health(self, message: Health) -> None:
        node = message.source
        since = self._since.get(node, 0)
        if message.since < since:
            return  # a late word of one that is dead
        if message.since > since:
            self._since[node] = message.since
            self._begun_anew(node, message.since, message.steps)
        self._steps[node] = message.steps
        if message.median > 0.0:  # a replay tells none
            self._times[node] = {"steps": message.steps, "median": message.median, "p99": message.p99}

    def _begun_anew(self, node: str, since: int, steps: int) -> None:
        """A node has begun anew, with a new state: a replay has to do so at the same place. Messages of its new life
        may have come before the word of it, which takes another way: `steps` of them where more came than are
        remembered."""
        streams = [stream.name for stream in self.streams if stream.producer == node]
        known = [self._recorded[name] for name in streams if name in self._recorded]
        known = [own for own in known if own.heard and own.first < since]  # else its first life, of a late beginning
        heard = (
            max(1, own.heard - steps) if own.last[0] >= since else own.heard - sum(tick >= since for tick in own.last)
            for own in known
        )
        before = max(heard, default=0)
        if self._file is None or before <= self._before.get(node, 0):
            return
        self._before[node] = before  # what the dead one sent last and did not arrive nobody knows
        try:
            self._writer.add_metadata("palpate.restarted", {"node": node, "tick": str(since)})
        except OSError as error:
            self._give_up(error)

    def lost(self, stream: Stream) -> int:
        """How many messages of a stream were sent and did not come. Where the sender did not tell how many it sent,
        the ticks without a message count."""
        steps = self._steps.get(stream.producer)
        if steps is None:
            return self._recorded[stream.name].gaps
        own, since = self._recorded[stream.name], self._since.get(stream.producer, 0)
        if own.skip > 1:  # of the steps since then those at its own ticks
            steps = -(-(since + steps * stream.every) // own.skip) + (-since // own.skip)
        return max(0, self._before.get(stream.producer, 0) + steps - own.heard)

    def _give_up(self, error: OSError) -> None:
        file, self._file = self._file, None
        assert file is not None
        self._recorded = {}  # nothing more is taken
        why = "the disk is full" if error.errno in _FULL else error.strerror
        self._notes.append(f"recording {self.path} ends here: {why}; what was written before can be read")
        self._writer.close()
        with contextlib.suppress(OSError):  # what is in its buffer cannot be written either
            file.close()

    def stop(self) -> None:
        if "_file" not in self.__dict__ or self._file is None:  # it never started, or has stopped
            return
        try:
            known = [stream for stream in self.streams if stream.name in self._recorded]
            counts = {s.name: {"count": self._recorded[s.name].count, "lost": self.lost(s)} for s in known}
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


def schema(kind: type[Message]) -> dict[str, Any]:
    """JSON schema of a message type, with unit, shape and dtype on each field."""
    names: dict[type, str] = {float: "number", int: "integer", bool: "boolean", str: "string"}
    properties: dict[str, Any] = {name: {"type": "integer"} for name in HEADER[:2]}
    properties["source"] = {"type": "string"}
    properties["used"] = {"type": "array", "items": {"type": "integer"}}
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
