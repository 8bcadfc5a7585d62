"""Recording: every stream as a channel of an MCAP file, the wire bytes as they are."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import sys
import time
import typing
from pathlib import Path
from typing import IO, Annotated, Any

import msgspec
from mcap.writer import CompressionType, Writer

from palpate.messages import Message, fields
from palpate.messages.base import HEADER
from palpate.nodes.base import Observer

CHUNK_TIME = 0.5  # [s] a chunk is closed at the latest after this time, so that a killed run loses no more
CHUNK_SIZE = 1 << 20  # [B]
PROFILE = "palpate"
SCHEMA_VERSION = "1"


class _Header(msgspec.Struct):
    tick: int
    time: int


_HEADER = msgspec.msgpack.Decoder(_Header)


class Mcap(Observer):
    """Writes what it hears to an MCAP file: channels with units in their schemas, and the run's provenance.

    A message that did not arrive (a gap in a stream's ticks) is counted in the file. A full disk ends the recording
    with one line and leaves a file that opens up to its last chunk; the run goes on.
    """

    path: Annotated[str, "1"] = "palpate.mcap"
    thin: Annotated[dict[str, int], "1"] = {}
    """Streams to thin out: name and n, to keep each n-th message."""
    leave_out: Annotated[tuple[str, ...], "1"] = ()
    """Streams not to record."""
    compression: Annotated[typing.Literal["zstd", "lz4", "none"], "1"] = "zstd"

    def start(self) -> None:
        self.lost: dict[str, int] = {}
        self.counts: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._next: dict[str, int] = {}
        self._file: IO[bytes] | None = None
        Path(self.path).parent.mkdir(parents=True, exist_ok=True)
        self._file = open(self.path, "wb", buffering=CHUNK_SIZE)  # noqa: SIM115 - lives until stop
        kinds = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}
        self._writer = Writer(self._file, chunk_size=CHUNK_SIZE, compression=kinds[self.compression])
        self._writer.start(profile=PROFILE, library="palpate")
        self._writer.add_metadata("palpate.about", {k: json.dumps(v) for k, v in self.about.items()})
        schemas: dict[type, int] = {}
        self._divisor = {}
        for stream in self.streams:
            if stream.name in self.leave_out:
                continue
            if stream.type not in schemas:
                text = json.dumps(schema(stream.type)).encode()
                schemas[stream.type] = self._writer.register_schema(stream.type.__name__, "jsonschema", text)
            about = {"producer": stream.producer, "every": str(stream.every)}
            self._channels[stream.name] = self._writer.register_channel(
                stream.name, "msgpack", schemas[stream.type], about
            )
            self._divisor[stream.name] = (stream.every, stream.every * self.thin.get(stream.name, 1))
            self.lost[stream.name] = self.counts[stream.name] = self._next[stream.name] = 0
        self._close_chunk()

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        if self._file is None or stream not in self._channels:
            return
        step, keep = self._divisor[stream]
        missing = (tick - self._next[stream]) // step
        if missing > 0:
            self.lost[stream] += missing
        self._next[stream] = tick + step
        if tick % keep:
            return
        at = max(0, _HEADER.decode(payload).time)
        try:
            self._writer.add_message(self._channels[stream], at, payload, at, tick & 0xFFFFFFFF)
            self.counts[stream] += 1
            if time.monotonic() > self._due:
                self._close_chunk()
        except OSError as error:
            self._give_up(error)

    def _close_chunk(self) -> None:
        # The writer closes a chunk by its size only; by its name-mangled method it closes one by time, too.
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined]
        assert self._file is not None
        self._file.flush()
        self._good = self._file.tell()
        self._due = time.monotonic() + CHUNK_TIME

    def _give_up(self, error: OSError) -> None:
        file, self._file = self._file, None
        assert file is not None
        why = "the disk is full" if error.errno == errno.ENOSPC else error.strerror
        print(f"recording {self.path} ends here: {why}; what was written before can be read", file=sys.stderr)
        descriptor = os.dup(file.fileno())
        with contextlib.suppress(OSError):  # its buffer cannot be written either: back to the last whole chunk
            file.close()
        os.ftruncate(descriptor, self._good)
        os.close(descriptor)

    def stop(self) -> None:
        if self._file is None:
            return
        try:
            counts = {name: json.dumps({"count": self.counts[name], "lost": self.lost[name]}) for name in self.counts}
            self._close_chunk()
            self._writer.add_metadata("palpate.counts", counts)
            self._writer.finish()
            self._file.close()
        except OSError as error:
            self._give_up(error)
        self._file = None


def schema(kind: type[Message]) -> dict[str, Any]:
    """JSON schema of a message type, with unit, shape and dtype on each field."""
    names: dict[type, str] = {float: "number", int: "integer", bool: "boolean", str: "string"}
    properties: dict[str, Any] = {name: {"type": "integer"} for name in HEADER[:2]}
    properties["source"] = {"type": "string"}
    properties["used"] = {"type": "array", "items": {"type": "integer"}}
    for field in fields(kind):
        found: dict[str, Any] = {"unit": field.unit, "shape": list(field.shape)}
        if field.dtype is not None:
            found |= {"type": "object", "dtype": field.dtype.str}
        elif field.shape:
            found |= {"type": "array", "items": {"type": "number"}}
        else:
            found["type"] = names.get(field.type, "string")
        properties[field.name] = found
    about = (kind.__doc__ or "").partition("\n")[0]
    return {
        "title": kind.__name__,
        "class": f"{kind.__module__}.{kind.__qualname__}",
        "version": SCHEMA_VERSION,
        "description": about,
        "type": "object",
        "properties": properties,
    }
