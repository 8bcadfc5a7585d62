"""Reading a recording: its streams as typed messages or as columns of numbers, and what it knows of its run."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader

from palpate.launch.loading.load import load_class
from palpate.messages import Message, MessageError, fields, unpack
from palpate.nodes.logger import PROFILE, SCHEMA_VERSION

# What the readers of the format raise on a file that is cut off or damaged.
_BROKEN = (McapError, EOFError, ValueError, RuntimeError, OSError, KeyError, struct.error, zstandard.ZstdError)


class RecordingError(ValueError):
    """A file that cannot be read as a recording; says what is wrong and what can still be done."""


@dataclass(frozen=True)
class Channelled:
    """One stream of a recording: name, message type, sending node, divisor of the base rate, units by field."""

    name: str
    type: type[Message]
    producer: str
    every: int


class Recording:
    """A recording on disk.

    path      of the file
    streams   what it holds, by name
    about     provenance of the run
    counts    per stream, how many messages were written and how many the logger did not get; empty after a crash
    complete  false where the file was cut off: it is read up to its last whole chunk

    RecordingError: missing, not MCAP, not palpate's, or of a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.streams: dict[str, Channelled] = {}
        self.about: dict[str, Any] = {}
        self.counts: dict[str, dict[str, int]] = {}
        self.complete = False
        self._channels: dict[int, str] = {}
        try:
            with open(self.path, "rb") as file:
                if file.read(8) != b"\x89MCAP0\r\n":
                    raise RecordingError(f"{path}: not an MCAP file")
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from None
        self._read_head()

    def _read_head(self) -> None:
        schemas: dict[int, Schema] = {}
        for record in self._indexed_head() or self._records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channel(record, schemas)
            elif isinstance(record, Metadata) and record.name == "palpate.about":
                self.about = {key: json.loads(value) for key, value in record.metadata.items()}
            elif isinstance(record, Metadata) and record.name == "palpate.counts":
                self.counts = {key: json.loads(value) for key, value in record.metadata.items()}
        if not self.about:
            raise RecordingError(
                f"{self.path}: an MCAP file, but not a recording of palpate (no {PROFILE}.about in it)"
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
        except _BROKEN:
            return []
        self.complete = True
        return head

    def _channel(self, channel: Channel, schemas: dict[int, Schema]) -> None:
        told = json.loads(schemas[channel.schema_id].data)
        if told.get("version") != SCHEMA_VERSION:
            raise RecordingError(
                f"{self.path}: stream {channel.topic!r} has schema version {told.get('version')!r}, "
                f"this palpate reads {SCHEMA_VERSION!r}; `palpate export` of the version that wrote it can convert it"
            )
        try:
            kind = load_class(told["class"])
        except (ImportError, AttributeError) as error:
            raise RecordingError(
                f"{self.path}: stream {channel.topic!r} holds {told['class']}, which cannot be imported: {error}"
            ) from None
        about = channel.metadata
        self.streams[channel.topic] = Channelled(channel.topic, kind, about["producer"], int(about["every"]))
        self._channels[channel.id] = channel.topic

    def _records(self) -> Iterator[Any]:
        """All records in the order of the file, chunks opened; ends at the first place that is cut off or broken."""
        with open(self.path, "rb") as file:
            reader = StreamReader(file, validate_crcs=True, record_size_limit=None)
            try:
                yield from reader.records
                self.complete = True
            except _BROKEN:
                self.complete = False

    def payloads(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Stream, time [ns] and wire bytes of each message of these streams (of all, if none is named), in the
        order in which they were recorded."""
        wanted = set(self._known(names) or self.streams)
        for record in self._records():
            if isinstance(record, Record) and self._channels.get(record.channel_id) in wanted:
                yield self._channels[record.channel_id], record.log_time, record.data

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
        return next((name for name, stream in self.streams.items() if stream.type is kind), None)

    def _known(self, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name not in self.streams:
                raise RecordingError(f"{self.path}: no stream {name!r}; streams: {', '.join(self.streams)}")
        return names
