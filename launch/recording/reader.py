"""Reading a recording: its streams as typed messages or as columns of numbers, and what it knows of its run."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader

from palpate.launch.loading.faults import choices
from palpate.launch.loading.load import full_name, load_class
from palpate.messages import Message, MessageError, fields, unpack
from palpate.nodes.logger import PROFILE, SCHEMA_VERSION

MAGIC = b"\x89MCAP0\r\n"
# What the readers of the format raise on a file that is cut off or damaged.
BROKEN = (
    McapError, EOFError, ValueError, RuntimeError, OSError, KeyError, TypeError, MemoryError, OverflowError,
    struct.error, zstandard.ZstdError,
)  # fmt: skip
_MESSAGE = 5  # opcode of the format
_RECORD = struct.Struct("<BQ")
_HEAD = struct.Struct("<HIQQ")
_OPEN: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "zstd": lambda data: zstandard.decompress(data),
    "lz4": lambda data: lz4.frame.decompress(data),
}
_MOST_TICKS = 1 << 31


class RecordingError(ValueError):
    """A file that cannot be read as a recording, or not for this purpose; says what can still be done."""


@dataclass(frozen=True)
class Channelled:
    """One stream of a recording: name, message type, sending node, divisor of the base rate, and `thin`: of how many
    messages one was kept; `schema` is the JSON schema as it stands in the file."""

    name: str
    schema: dict[str, Any]
    producer: str
    every: int
    thin: int
    path: Path

    @property
    def type(self) -> type[Message]:
        """RecordingError: the class cannot be imported."""
        try:
            return load_class(self.schema["class"])
        except (ImportError, AttributeError) as error:
            raise RecordingError(
                f"{self.path}: stream {self.name!r} holds {self.schema['class']}, which cannot be imported: {error}. "
                "Run from the folder that has it; the other streams can be read."
            ) from None


class Recording:
    """A recording on disk.

    path       of the file
    streams    what it holds, by name
    about      provenance of the run
    counts     per stream, how many messages were written and how many the logger did not get; empty after a crash
    restarted  nodes that were started again during the run, and the tick from which they began anew
    complete   false where the file was cut off: it is read up to its last whole chunk

    RecordingError: missing, not MCAP, not palpate's, or of a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.streams: dict[str, Channelled] = {}
        self.about: dict[str, Any] = {}
        self.counts: dict[str, dict[str, int]] = {}
        self.restarted: dict[str, list[int]] = {}
        self.complete = False
        self._channels: dict[int, str] = {}
        try:
            with open(self.path, "rb") as file:
                begin = file.read(8)
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from None
        if begin != MAGIC:
            what = "an empty file" if not begin else "not an MCAP file"
            raise RecordingError(f"{path}: {what}; recordings are written by `palpate run --record FILE`")
        self._read_head()

    def _read_head(self) -> None:
        schemas: dict[int, Schema] = {}
        for record in self._indexed_head() or self._opened_records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channel(record, schemas)
            elif isinstance(record, Metadata) and record.name == "palpate.about":
                self.about = {key: json.loads(value) for key, value in record.metadata.items()}
            elif isinstance(record, Metadata) and record.name == "palpate.counts":
                self.counts = {key: json.loads(value) for key, value in record.metadata.items()}
            elif isinstance(record, Metadata) and record.name == "palpate.restarted":
                told = record.metadata
                self.restarted.setdefault(told["node"], []).append(int(told["tick"]))
        if not self.about:
            cut = "cut off before its first message" if not self.complete else f"no {PROFILE}.about in it"
            raise RecordingError(
                f"{self.path}: an MCAP file, but not a recording of palpate ({cut}); nothing to recover"
            )

    def _indexed_head(self) -> list[Any]:
        """Schemas, channels and metadata from the index at the end of a complete file; empty without one."""
        try:
            with open(self.path, "rb") as file:
                reader = make_reader(file)
                found = reader.get_summary()
                if found is None:
                    return []
                head = [*found.schemas.values(), *found.channels.values(), *reader.iter_metadata()]
        except BROKEN:
            return []
        self.complete = True
        return head

    def _channel(self, channel: Channel, schemas: dict[int, Schema]) -> None:
        told = json.loads(schemas[channel.schema_id].data)
        if told.get("version") != SCHEMA_VERSION:
            raise RecordingError(
                f"{self.path}: stream {channel.topic!r} has schema version {told.get('version')!r}, this palpate reads "
                f"{SCHEMA_VERSION!r}; `palpate export` of the version that wrote it can convert it"
            )
        about = channel.metadata
        self.streams[channel.topic] = Channelled(
            channel.topic, told, about["producer"], int(about["every"]), int(about.get("thin", "1")), self.path
        )
        self._channels[channel.id] = channel.topic

    def _records(self) -> Iterator[Any]:
        """All records in the order of the file, chunks as they are; ends where the file is cut off or broken."""
        with open(self.path, "rb") as file:
            size = self.path.stat().st_size
            reader = StreamReader(file, emit_chunks=True, record_size_limit=size)
            try:
                yield from reader.records
                self.complete = True
            except BROKEN:
                self.complete = False

    def _opened_records(self) -> Iterator[Any]:
        with open(self.path, "rb") as file:
            reader = StreamReader(file, validate_crcs=True, record_size_limit=self.path.stat().st_size)
            try:
                yield from (record for record in reader.records if not isinstance(record, Record))
            except BROKEN:
                return

    def _chunks(self) -> Iterator[bytes]:
        for record in self._records():
            if isinstance(record, Chunk):
                data = _opened(record)
                if data is None:
                    self.complete = False
                    return
                yield data

    def raw(self) -> Iterator[tuple[str, int, int, bytes]]:
        """Stream, tick, time [ns] and wire bytes of each message, in the order in which they were recorded."""
        channels = self._channels
        for chunk in self._chunks():
            at, end = 0, len(chunk)
            while at + 9 <= end:
                kind, length = _RECORD.unpack_from(chunk, at)
                at += 9
                if kind == _MESSAGE:
                    channel, tick, time, _ = _HEAD.unpack_from(chunk, at)
                    name = channels.get(channel)
                    if name is not None:
                        yield name, tick, time, chunk[at + 22 : at + length]
                at += length

    def payloads(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Stream, time [ns] and wire bytes of each message of these streams (of all, if none is named), in the
        order in which they were recorded."""
        wanted = set(self._known(names) or self.streams)
        for name, _, time, payload in self.raw():
            if name in wanted:
                yield name, time, payload

    def ticks(self) -> dict[str, np.ndarray]:
        """Of each stream, at which ticks it has a message: one truth value per tick.

        RecordingError: a stream that goes back in time, as no run writes it.
        """
        found = {name: bytearray() for name in self.streams}
        for name, tick, _, _ in self.raw():
            row = found[name]
            if tick >= len(row):
                if tick >= _MOST_TICKS:
                    raise RecordingError(f"{self.path}: stream {name!r}: tick {tick}, expected less than 2^31")
                row.extend(bytes(tick + 1 - len(row)))
            elif row[tick]:
                raise RecordingError(f"{self.path}: stream {name!r} has tick {tick} twice; `palpate info` and `export` "
                                     "can still read it")  # fmt: skip
            row[tick] = 1
        length = max(map(len, found.values()), default=0)
        return {
            name: np.frombuffer(bytes(row) + bytes(length - len(row)), dtype=np.uint8).astype(bool)
            for name, row in found.items()
        }

    def messages(self, name: str) -> Iterator[Message]:
        """The messages of one stream. RecordingError: no such stream, or bytes that do not fit its type."""
        (name,) = self._known((name,))
        kind = self.streams[name].type
        for _, _, payload in self.payloads(name):
            try:
                yield unpack(payload, kind)
            except MessageError as error:
                raise RecordingError(f"{self.path}: stream {name!r}: {error}") from None

    def columns(self, name: str) -> dict[str, np.ndarray]:
        """Time [s], tick and all numbers and vectors of one stream, one row a message; fields with arrays of
        changing length are left out."""
        found = list(self.messages(name))
        columns: dict[str, np.ndarray] = {
            "tick": np.array([m.tick for m in found], dtype=np.int64),
            "time": np.array([m.time for m in found], dtype=float) * 1e-9,
        }
        for field in fields(self.streams[name].type):
            if field.dtype is None and field.type is not str:
                values = [getattr(m, field.name) for m in found]
                if len({len(v) if isinstance(v, tuple) else -1 for v in values}) <= 1:
                    columns[field.name] = np.array(values)
        return columns

    def stream_of(self, kind: type[Message]) -> str | None:
        """The first stream of this message type, None where there is none."""
        wanted = full_name(kind)
        return next((name for name, stream in self.streams.items() if stream.schema["class"] == wanted), None)

    def rename(self, old: str, new: str, producer: str) -> None:
        """Call a stream otherwise, as if this node had sent it."""
        self.streams[new] = replace(self.streams.pop(old), name=new, producer=producer)
        self._channels = {key: new if name == old else name for key, name in self._channels.items()}

    def known(self, name: str) -> Channelled:
        """The stream of this name. RecordingError: there is none; names the nearest."""
        return self.streams[self._known((name,))[0]]

    def _known(self, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name not in self.streams:
                close = choices("Streams", name, self.streams)
                raise RecordingError(f"{self.path}: no stream {name!r}. {close}")
        return names


def _opened(chunk: Chunk) -> bytes | None:
    """What is in a chunk; None where it is damaged."""
    try:
        data = _OPEN[chunk.compression](chunk.data)
    except BROKEN:
        return None
    return data if not chunk.uncompressed_crc or zlib.crc32(data) == chunk.uncompressed_crc else None
