"""Writes an MCAP file (https://mcap.dev) at the speed of a force loop.

The caller only packs the head of a message and appends to a list, or adds a function that makes many records. Once per
chunk a thread does the rest: it makes and joins the records, makes their index (with numpy), and compresses and writes
the bytes. The `mcap` package makes the small records (schemas, channels, metadata, the summary).
"""

import json
import os
import struct
import zlib
from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise
from typing import IO, Any

import lz4.frame
import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from palpate.records.format.head import Compression
from palpate.records.format.message_head import HEAD, HEAD_LENGTH

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "palpate, sealed"  # in the header of a file: its metadata have checksums
SEAL = "crc32"
CHUNK_SIZE = 1 << 20  # [B]
IN_FLIGHT = 4  # chunks that may wait for the disk; then the caller blocks, so that memory stays bounded
LEVEL = -5  # of zstd: level 1 takes 2.6 × as long for 4 % less, since most bits of doubles are random

_MESSAGE = struct.Struct("<BQHIQQ")  # a `HEAD`
_CHUNK = struct.Struct("<BQQQQI")  # opcode, length; first and last time, bytes unpacked, their checksum
_INDEX = struct.Struct("<BQHI")  # opcode, length; channel, bytes of entries
_RECORD = 9  # [B] opcode and length of a record
_ENTRY = np.dtype([("time", "<u8"), ("place", "<u8")])

Piece = tuple[Any, ...]
"""The heads of messages, then the records of these messages, as bytes."""

_COMPRESS: dict[Compression, Callable[[], Callable[[Any], bytes]]] = {
    "zstd": lambda: zstandard.ZstdCompressor(level=LEVEL).compress,
    "lz4": lambda: lz4.frame.compress,
    "none": lambda: lambda data: data,
}
"""Make a function that compresses chunks, and keeps its workspace for the next one."""


def seal(name: str, data: dict[str, str]) -> str:
    """Checksum of metadata and their name."""
    return f"{zlib.crc32(json.dumps([name, sorted(data.items())]).encode()):08x}"


class McapWriter:
    """Writes one file, with checksums, message indexes, statistics and a summary.

    file  open for writing; the caller closes it

    OSError: a chunk could not be written; the next call raises it.
    """

    def __init__(self, file: IO[bytes], profile: str, compression: Compression = "zstd") -> None:
        self._file, self._name = file, "" if compression == "none" else compression
        self._compress = _COMPRESS[compression]()
        self._thread = ThreadPoolExecutor(1, "recording", _calm)
        self._waiting: deque[Future[None]] = deque()
        self._at = self._checksum = 0
        self._failed: OSError | None = None
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._chunks, self._chunk_count = bytearray(), 0  # packed indexes: as objects they take 3 kB for each chunk
        self._begin, self._end = (1 << 64) - 1, 0  # [ns] of the first and the last message
        self._metadata: list[records.MetadataIndex] = []
        self._attachments: list[records.AttachmentIndex] = []
        self._counts: Counter[int] = Counter()
        self._declared, self._pieces = b"", list[Callable[[], Piece] | Piece]()
        self._size = 0
        self._write(MAGIC, record_bytes(records.Header(profile, LIBRARY)))

    def add_schema(self, name: str, data: bytes) -> int:
        """Declare a JSON schema; returns its number."""
        return self._declare(self._schemas, records.Schema(len(self._schemas) + 1, data, "jsonschema", name))

    def add_channel(self, topic: str, encoding: str, schema: int, about: dict[str, str]) -> int:
        """Declare a channel before its first message; returns its number."""
        return self._declare(self._channels, records.Channel(len(self._channels) + 1, topic, encoding, about, schema))

    def _declare(self, known: list[Any], record: Any) -> int:
        if self._size:
            self.close_chunk()
        self._declared += record_bytes(record)  # inside a chunk, so that the chunk's checksum covers it
        known.append(record)
        return len(known)

    def add_message(self, channel: int, tick: int, time: int, payload: bytes) -> None:
        """Add a message; `time` [ns]."""
        length = HEAD_LENGTH + len(payload)
        head = _MESSAGE.pack(Opcode.MESSAGE, length, channel, tick & 0xFFFFFFFF, time, time)
        self._pieces.append((head, head, payload))
        self._size += length
        if self._size > CHUNK_SIZE:
            self.close_chunk()

    def add_block(self, make: Callable[[], Piece], size: int) -> None:
        """Add message records of `size` bytes, which the thread makes. A large block ends its chunk, so that it need
        not be joined with others."""
        self._pieces.append(make)
        self._size += size
        if 2 * size > CHUNK_SIZE or self._size > CHUNK_SIZE:
            self.close_chunk()

    @property
    def full(self) -> bool:
        """Whether `close_chunk` would block."""
        while self._waiting and self._waiting[0].done():
            self._waiting.popleft().result()
        return len(self._waiting) >= IN_FLIGHT

    def close_chunk(self) -> None:
        """Pass the buffered messages to the thread."""
        if not self._size:
            return
        while self.full:
            self._waiting.popleft().result()
        self._waiting.append(self._thread.submit(self._write_chunk, self._declared, self._pieces))
        self._declared, self._pieces, self._size = b"", [], 0

    def flush(self) -> None:
        """Wait until all messages are in the file."""
        self.close_chunk()
        while self._waiting:
            self._waiting.popleft().result()

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write metadata with their checksum after the messages so far."""
        self.flush()
        record = record_bytes(records.Metadata(name, {**data, SEAL: seal(name, data)}))
        self._metadata.append(records.MetadataIndex(self._at, len(record), name))
        self._write(record)

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write a file after the messages so far."""
        self.flush()
        record = record_bytes(records.Attachment(0, 0, name, media_type, data))
        self._attachments.append(records.AttachmentIndex(self._at, len(record), 0, 0, len(data), name, media_type))
        self._write(record)

    def finish(self) -> None:
        """Write the summary, which completes the file."""
        self.flush()
        self._write(record_bytes(records.DataEnd(self._checksum)))
        start, summary, offsets = self._at, b"", b""
        for kind, group in self._summary():
            if group:
                offsets += record_bytes(records.SummaryOffset(kind, start + len(summary), len(group)))
            summary += group
        footer = record_bytes(records.Footer(start, start + len(summary), 0))[:-4]
        checksum = zlib.crc32(footer, zlib.crc32(summary + offsets))
        self._write(summary, offsets, footer, checksum.to_bytes(4, "little"), MAGIC)
        self.close()

    def close(self) -> None:
        """End the thread; discard buffered messages."""
        self._thread.shutdown(cancel_futures=True)

    def _summary(self) -> Iterable[tuple[Opcode, bytes]]:
        """Kinds of records, and their bytes."""
        statistics = records.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunk_count,
            message_count=self._counts.total(),
            metadata_count=len(self._metadata),
            message_start_time=self._begin if self._chunk_count else 0,
            message_end_time=self._end,
            schema_count=len(self._schemas),
        )
        yield Opcode.SCHEMA, packed(self._schemas)
        yield Opcode.CHANNEL, packed(self._channels)
        yield Opcode.STATISTICS, packed([statistics])
        yield Opcode.CHUNK_INDEX, bytes(self._chunks)
        yield Opcode.METADATA_INDEX, packed(self._metadata)
        yield Opcode.ATTACHMENT_INDEX, packed(self._attachments)

    def _write_chunk(self, declared: bytes, pieces: list[Callable[[], Piece] | Piece]) -> None:
        """Write a chunk and its index."""
        packed_heads, parts = list[bytes](), [declared] if declared else []
        for piece in pieces:
            head, *joined = piece() if callable(piece) else piece
            packed_heads.append(head)
            parts += joined
        data = parts[0] if len(parts) == 1 else b"".join(parts)
        heads = np.frombuffer(b"".join(packed_heads), HEAD)
        packed = self._compress(data)
        name = self._name.encode()
        tail = len(name).to_bytes(4, "little") + name + len(packed).to_bytes(8, "little")
        begin, end = int(heads["time"].min()), int(heads["time"].max())
        length = _CHUNK.size - _RECORD + len(tail) + len(packed)
        chunk = _CHUNK.pack(Opcode.CHUNK, length, begin, end, len(data), zlib.crc32(data)) + tail
        place = self._at + len(chunk) + len(packed)
        offsets, index = {}, b""
        for channel, entries in _entries(heads, len(declared)):
            offsets[channel] = place + len(index)
            index += _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX.size - _RECORD + entries.nbytes, channel, entries.nbytes)
            index += entries.tobytes()
            self._counts[channel] += len(entries)
        self._chunk_count += 1
        self._begin, self._end = min(self._begin, begin), max(self._end, end)
        self._chunks += record_bytes(records.ChunkIndex(
            chunk_length=len(chunk) + len(packed), chunk_start_offset=self._at, compression=self._name,
            compressed_size=len(packed), message_end_time=end, message_index_length=len(index),
            message_index_offsets=offsets, message_start_time=begin, uncompressed_size=len(data),
        ))  # fmt: skip
        self._write(chunk, packed, index)

    def _write(self, *parts: bytes) -> None:
        if self._failed is not None:  # do not write after a gap
            raise self._failed
        try:
            for part in parts:
                self._file.write(part)
                self._at += len(part)
                self._checksum = zlib.crc32(part, self._checksum)
            self._file.flush()
        except OSError as error:
            self._failed = error
            raise


def _entries(heads: np.ndarray, begin: int) -> Iterable[tuple[int, np.ndarray]]:
    """Time and position in the chunk of each message, by channel; `begin`: position of the first."""
    sizes = heads["length"] + np.uint64(_RECORD)
    entries = np.empty(len(heads), _ENTRY)
    entries["time"] = heads["time"]
    entries["place"] = np.cumsum(sizes) - sizes + np.uint64(begin)
    channels = heads["channel"].copy()
    entries, ends = entries[np.argsort(channels, kind="stable")], np.cumsum(np.bincount(channels)).tolist()
    for channel, (begin, end) in enumerate(pairwise([0, *ends])):
        if begin < end:
            yield channel, entries[begin:end]


def record_bytes(record: records.McapRecord) -> bytes:
    """A record as bytes."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def packed(every: Iterable[records.McapRecord]) -> bytes:
    """Records as bytes, one after the other."""
    return b"".join(map(record_bytes, every))


def _calm() -> None:
    """Reset the thread's priority, so that it never preempts a real-time loop."""
    with suppress(OSError, AttributeError):  # not permitted, or not Linux
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
