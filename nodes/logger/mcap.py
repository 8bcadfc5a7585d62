"""Recording: every stream as a channel of an MCAP file, the wire bytes as they are."""

from __future__ import annotations

import contextlib
import errno
import json
import time
import typing
from collections import deque
from pathlib import Path
from typing import IO, Annotated, Any

import msgspec
from mcap.writer import CompressionType, Writer

from palpate.messages import Health, Message, fields
from palpate.messages.base import HEADER
from palpate.nodes.base import Observer, SettingError, Stream
from palpate.records.format.mcap_file import LIBRARY, add_metadata

CHUNK_SIZE = 1 << 20  # [B]
LATEST = 1024  # ticks of a stream by which a node's new life is told from the one before
PROFILE = "palpate"
SCHEMA_VERSION = "1"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class _Header(msgspec.Struct):
    tick: int
    time: int


_HEADER = msgspec.msgpack.Decoder(_Header)


class Mcap(Observer):
    """Writes the streams to an MCAP file: channels with units in their schemas, and the run's provenance.

    What it did not get is counted in the file, per stream: messages that their node sent and that did not come. A full
    disk ends the recording with one line and leaves a file that opens up to its last chunk; the run goes on. A run that
    is killed leaves such a file, too.
    """

    effect = "recording"

    path: Annotated[str, "1"] = "palpate.mcap"
    thin: Annotated[dict[str, int], "1"] = {}
    """Streams to thin out: name and n, to keep each n-th message."""
    leave_out: Annotated[tuple[str, ...], "1"] = ()
    """Streams not to record."""
    within: Annotated[float, "s", msgspec.Meta(ge=0.0, le=60.0)] = 0.2
    """What has come is in the file after this time at the latest. A kill of everything costs that, and what was still
    under way to the logger: 0.7 to 1.3 s in all were measured where simulated time is paced."""
    fields: Annotated[tuple[str, ...] | typing.Literal["all"], "1"] = ()
    """Of a stream that other nodes read too: fields to compute for the recording, beside those that are read."""
    compression: Annotated[typing.Literal["zstd", "lz4", "none"], "1"] = "zstd"

    def start(self) -> None:
        known = {stream.name for stream in self.streams}
        for name in (*self.thin, *self.leave_out):
            if name not in known:
                raise SettingError(f"there is no stream {name!r} to thin or leave out; streams: {', '.join(known)}")
        for name, keep in self.thin.items():
            if keep < 1:
                raise SettingError(f"thin: {name}: found {keep}, expected to keep each n-th message, n from 1")
        self.counts: dict[str, int] = {}
        self._heard: dict[str, int] = {}
        self._gaps: dict[str, int] = {}
        self._last: dict[str, deque[int]] = {}
        self._steps: dict[str, int] = {}
        self._times: dict[str, dict[str, float]] = {}
        self._since: dict[str, int] = {}
        self._before: dict[str, int] = {}
        self._notes: list[str] = []
        self._channels: dict[str, int] = {}
        self._next: dict[str, int] = {}
        self._due_at: dict[str, int] = {}
        self._file: IO[bytes] | None = None
        Path(self.path).parent.mkdir(parents=True, exist_ok=True)
        self._file = open(self.path, "wb", buffering=CHUNK_SIZE)  # noqa: SIM115 - lives until stop
        kinds = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}
        self._writer = Writer(
            self._file, chunk_size=CHUNK_SIZE, compression=kinds[self.compression], enable_data_crcs=True
        )
        self._writer.start(profile=PROFILE, library=LIBRARY)
        add_metadata(self._writer, "palpate.about", {k: json.dumps(v) for k, v in self.about.items()})
        schemas: dict[type, int] = {}
        self._divisor = {}
        for stream in self.streams:
            if stream.name in self.leave_out:
                continue
            if stream.type not in schemas:
                text = json.dumps(schema(stream.type)).encode()
                schemas[stream.type] = self._writer.register_schema(stream.type.__name__, "jsonschema", text)
            keep = self.thin.get(stream.name, 1)
            about = {"producer": stream.producer, "every": str(stream.every), "thin": str(keep)}
            self._channels[stream.name] = self._writer.register_channel(
                stream.name, "msgpack", schemas[stream.type], about
            )
            self._divisor[stream.name] = (stream.every, stream.every * keep if keep > 1 else 1)
            self.counts[stream.name] = self._next[stream.name] = self._due_at[stream.name] = 0
            self._heard[stream.name] = self._gaps[stream.name] = 0
            self._last[stream.name] = deque(maxlen=LATEST)
        self._close_chunk()

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        if self._file is None or stream not in self._channels:
            return
        step, keep = self._divisor[stream]
        missing = (tick - self._next[stream]) // step
        if missing > 0:
            self._gaps[stream] += missing
        self._next[stream] = tick + step
        self._heard[stream] += 1
        self._last[stream].append(tick)
        if tick < self._due_at[stream]:
            return
        self._due_at[stream] = tick - tick % keep + keep  # also where the clock left out the very tick
        at = max(0, _HEADER.decode(payload).time)
        try:
            self._writer.add_message(self._channels[stream], at, payload, at, tick & 0xFFFFFFFF)
            self.counts[stream] += 1
            if time.monotonic() > self._due:
                self._close_chunk()
        except OSError as error:
            self._give_up(error)

    def health(self, message: Health) -> None:
        node = message.source
        since = self._since.setdefault(node, message.since)
        if message.since < since:
            return  # a late word of one that is dead
        if message.since > since:
            self._since[node] = message.since
            self._begun_anew(node, message.since)
        self._steps[node] = message.steps
        if message.median > 0.0:  # a replay tells none
            self._times[node] = {"steps": message.steps, "median": message.median, "p99": message.p99}

    def _begun_anew(self, node: str, since: int) -> None:
        """A node has begun anew, with a new state: a replay has to do so at the same place. Messages of its new life
        may have come before the word of it, which takes another way."""
        streams = [stream.name for stream in self.streams if stream.producer == node and stream.name in self._heard]
        heard = (self._heard[name] - sum(tick >= since for tick in self._last[name]) for name in streams)
        before = max(heard, default=0)
        if self._file is None or before <= self._before.get(node, 0):
            return
        self._before[node] = before  # what the dead one sent last and did not arrive nobody knows
        try:
            self._close_chunk()
            add_metadata(self._writer, "palpate.restarted", {"node": node, "tick": str(since)})
        except OSError as error:
            self._give_up(error)

    def notes(self) -> list[str]:
        notes, self._notes = self._notes, []
        return notes

    def lost(self, stream: Stream) -> int:
        """How many messages of a stream were sent and did not come. Where the sender did not tell how many it sent,
        the ticks without a message count."""
        steps = self._steps.get(stream.producer)
        if steps is None:
            return self._gaps[stream.name]
        return max(0, self._before.get(stream.producer, 0) + steps - self._heard[stream.name])

    def _close_chunk(self) -> None:
        # The writer closes a chunk by its size only; by its name-mangled method it closes one by time, too.
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined]
        assert self._file is not None
        self._file.flush()
        self._due = time.monotonic() + self.within

    def _give_up(self, error: OSError) -> None:
        file, self._file = self._file, None
        assert file is not None
        why = "the disk is full" if error.errno in _FULL else error.strerror
        self._notes.append(f"recording {self.path} ends here: {why}; what was written before can be read")
        with contextlib.suppress(OSError):  # what is in its buffer cannot be written either
            file.close()

    def stop(self) -> None:
        if self._file is None:
            return
        try:
            known = [stream for stream in self.streams if stream.name in self._channels]
            counts = {s.name: {"count": self.counts[s.name], "lost": self.lost(s)} for s in known}
            self._close_chunk()
            add_metadata(self._writer, "palpate.counts", {name: json.dumps(value) for name, value in counts.items()})
            add_metadata(
                self._writer, "palpate.times", {name: json.dumps(losses) for name, losses in self._times.items()}
            )
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
