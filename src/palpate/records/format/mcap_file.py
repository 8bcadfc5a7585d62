"""The records of a recording, an MCAP file (https://mcap.dev), each verified against its checksum.

MCAP has checksums of the contents of a chunk (messages, and the schemas and channels before them), of attachments, of
the summary at the end, and of all data of a complete file. Metadata have none, so those of a truncated file could not
be verified; therefore each metadata record has an additional key with its checksum, `SEAL`.
"""

import json
import os
import struct
import zlib
from collections.abc import Callable, Container, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Header, Metadata, MetadataIndex, Schema

from palpate.physics.readable import check_readable
from palpate.records.format.mcap_writer import LIBRARY, MAGIC, SEAL, seal

_RECORD = struct.Struct("<BQ")
_HEAD = struct.Struct("<HIQQ")  # of a message: channel, sequence number (its tick), and two times
_FOOTER = _RECORD.size + 20 + len(MAGIC)
_DATA_END = _RECORD.size + 4
_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex, Opcode.CHUNK: Chunk, Opcode.FOOTER: Footer,
}  # fmt: skip
_IN_DATA = {Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT,
            Opcode.METADATA}  # fmt: skip
# Exceptions of the libraries on invalid bytes; lz4 raises only RuntimeError.
_BAD = (McapError, EOFError, ValueError, RuntimeError, KeyError, TypeError, MemoryError, OverflowError, struct.error,
        zstandard.ZstdError)  # fmt: skip
BLOCK = 1 << 20
MOST = 1 << 28
"""[bytes] Largest chunk, compressed or not, and largest index at the end. A logger begins a new chunk long before, and
fills such an index in 50 hours."""
MOST_HEAD = 1 << 24
"""[bytes] Limit of schemas, channels and metadata, each and in total: 100 times those of the largest graph. They
are parsed as JSON, which takes up to 30 times as much memory."""


def lacking(path: Path) -> str:
    """The missing part of a recording, in one line: its end, or lost messages; empty if it is complete."""
    try:
        with path.open("rb") as file:
            metadata = [record for record in McapRecords(file).read_index() if isinstance(record, Metadata)]
    except (OSError, Broken) as error:
        return f"recording {path} is not complete: {error}"
    counts = next((record.metadata for record in metadata if record.name == "palpate.counts"), {})
    lost = {name: json.loads(entry)["lost"] for name, entry in counts.items()}
    losses = ", ".join(f"{name} {number}" for name, number in lost.items() if number)
    return f"recording {path} lacks messages that did not reach it in time: {losses}" if losses else ""


class Broken(Exception):
    """Missing or damaged bytes of a file; everything after them is unreliable.

    at   the byte where the damage begins
    cut  the file ends there: it was truncated
    """

    def __init__(self, at: int, what: str, cut: bool = False) -> None:
        super().__init__(f"{'cut off' if cut else 'damaged'} at byte {at}: {what}")
        self.at, self.cut = at, cut


class McapRecords:
    """The records of one file, in order: headers, schemas, channels, metadata and decompressed chunks.

    Broken: the file is truncated or damaged here; the records before are valid.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self.file = file
        self.size = os.fstat(file.fileno()).st_size
        self.is_sealed = False

    def __iter__(self) -> Iterator[Header | Schema | Channel | Metadata | bytes]:
        """Records from the beginning to the end of the data; a chunk as the bytes of its records."""
        self.file.seek(0)
        if self.file.read(len(MAGIC)) != MAGIC:
            raise Broken(0, "this is no MCAP file")
        for at, kind in self._places():
            if kind not in _IN_DATA:
                raise Broken(at, f"unexpected record of kind {kind}")
            if kind == Opcode.CHUNK:
                yield self.chunk(at)
            elif kind in _KINDS:
                yield self._check_record(at, _parse(at, _KINDS[kind], self._record(at)[1]))
            elif kind == Opcode.MESSAGE_INDEX:
                self._check_index(at)

    def chunks(self) -> Iterator[tuple[int, bytes]]:
        """Position and contents of each chunk, up to the first damage."""
        try:
            for at, kind in self._places():
                if kind == Opcode.CHUNK:
                    yield at, self.chunk(at)
        except Broken:
            return

    def chunk(self, at: int) -> bytes:
        """The contents of the chunk at this position."""
        return _open(at, _parse(at, Chunk, self._record(at)[1]))

    def attachments(self) -> Iterator[tuple[str, str, bytes]]:
        """Name, media type and content of each attachment before the first chunk. Broken: one is damaged."""
        for at, kind in self._places():
            if kind == Opcode.CHUNK:
                return
            if kind == Opcode.ATTACHMENT:
                content = self._record(at)[1]
                if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
                    raise Broken(at, "an attached file does not match its checksum")
                record = _parse(at, Attachment, content)
                yield record.name, record.media_type, record.data

    def _places(self) -> Iterator[tuple[int, int]]:
        """Position and kind of each record, to the end of the data, without reading the contents."""
        at = len(MAGIC)
        while True:
            kind, length = self._about(at)
            if kind == Opcode.DATA_END:
                return
            yield at, kind
            at += _RECORD.size + length

    def read_index(self) -> list[Schema | Channel | Metadata]:
        """Schemas, channels and metadata of a complete file, from the summary at its end. Broken: the file is truncated
        or damaged anywhere."""
        self._check_record(len(MAGIC), _parse(len(MAGIC), Header, self._record(len(MAGIC))[1]))
        start, crc = self._summary()
        if self.size - _FOOTER - start > MOST:
            raise Broken(start, f"the index at its end is longer than {MOST} bytes")
        summary = self._bytes(start, self.size - _FOOTER - start)
        footer = self._bytes(self.size - _FOOTER, _RECORD.size + 16)
        if crc and zlib.crc32(footer, zlib.crc32(summary)) != crc:
            raise Broken(start, "the index at its end does not match its checksum")
        self._check_data(start)
        records: list[Any] = []
        read = 0
        for at, kind, content in _inside(summary, start):
            if kind == Opcode.METADATA_INDEX:
                place = _parse(at, MetadataIndex, content).offset
                content = self._record(place)[1]
                records.append(self._check_record(place, _parse(place, Metadata, content)))
            elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                records.append(_parse(at, _KINDS[kind], content))
            else:
                continue
            read += len(content)  # an index may refer to one record many times
            if read > MOST_HEAD:
                raise Broken(at, f"more than {MOST_HEAD} bytes of streams and metadata")
        return records

    def _summary(self) -> tuple[int, int]:
        at = self.size - _FOOTER
        if at < len(MAGIC):
            raise Broken(self.size, "the end is missing", cut=True)
        kind, content = self._record(at)
        if kind != Opcode.FOOTER or self._bytes(self.size - len(MAGIC), len(MAGIC)) != MAGIC:
            raise Broken(self.size, "the index at the end is missing", cut=True)
        footer = _parse(at, Footer, content)
        if not _DATA_END < footer.summary_start <= at:
            raise Broken(at, "there is no index at the end")
        return footer.summary_start, footer.summary_crc

    def _check_data(self, end: int) -> None:
        """Compare all data with their checksum, if there is one; `end`: position of the summary."""
        kind, content = self._record(end - _DATA_END)
        if kind != Opcode.DATA_END or len(content) != 4:
            raise Broken(end - _DATA_END, "the end of the data is missing")
        expected = int.from_bytes(content, "little")
        if not expected:
            return
        checksum, left = 0, end - _DATA_END
        self.file.seek(0)
        while left > 0:
            block = self.file.read(min(BLOCK, left))
            checksum, left = zlib.crc32(block, checksum), left - len(block)
            if not block:
                raise Broken(end - left, "the file has become shorter", cut=True)
        if checksum != expected:
            raise Broken(0, "the data do not match their checksum")

    def _record(self, at: int) -> tuple[int, bytes]:
        kind, length = self._about(at)
        most = MOST if kind == Opcode.CHUNK else MOST_HEAD
        if length > most:  # a sparse file can be long enough for any length
            raise Broken(at, f"a record of {length} bytes, expected at most {most}")
        return kind, self._bytes(at + _RECORD.size, length)

    def _about(self, at: int) -> tuple[int, int]:
        """Kind and length of a record. Broken: the file ends within it."""
        kind, length = _RECORD.unpack(self._bytes(at, _RECORD.size))
        if at + _RECORD.size + length > self.size:
            raise Broken(at, "the file ends within this record", cut=True)
        return kind, length

    def _check_index(self, at: int) -> None:
        """Broken: a message index has a wrong length (such as a chunk whose kind has one flipped bit)."""
        _, length = self._about(at)
        head = self._bytes(at + _RECORD.size, min(length, 6))
        if length != 6 + int.from_bytes(head[2:], "little"):
            raise Broken(at, "a message index with a wrong length")

    def _bytes(self, at: int, length: int) -> bytes:
        if at < 0 or at + length > self.size:
            raise Broken(at, "the file ends within this record", cut=True)
        self.file.seek(at)
        return self.file.read(length)

    def _check_record(self, at: int, record: Any) -> Any:
        """The record; metadata without their checksum. Broken: the checksum does not match."""
        if isinstance(record, Header):
            self.is_sealed = record.library == LIBRARY
        elif isinstance(record, Metadata):
            found = record.metadata.pop(SEAL, None)
            if found != seal(record.name, record.metadata) and (found is not None or self.is_sealed):
                raise Broken(at, f"metadata {record.name!r} do not match their checksum")
        return record


def read_records(path: str | Path) -> Iterator[Header | Schema | Channel | Metadata | bytes]:
    """The records of a file, see `McapRecords`. OSError, Broken."""
    check_readable(path)
    with open(path, "rb") as file:
        yield from McapRecords(file)


def messages(chunk: bytes, wanted: Container[int] | None = None) -> Iterator[tuple[int, int, int, bytes]]:
    """Channel, tick, time [ns] and encoded bytes of the messages in a decompressed chunk.

    wanted  channels whose messages are given; None: all
    """
    message, size = int(Opcode.MESSAGE), _HEAD.size
    for at, kind, begin, end in _spans(chunk):
        if kind == message:
            if end - begin < size:
                raise Broken(at, "a message without its head")
            channel, tick, time, _ = _HEAD.unpack_from(chunk, begin)
            if wanted is None or channel in wanted:
                yield channel, tick, time, chunk[begin + size : end]


def read_declarations(chunk: bytes) -> Iterator[Schema | Channel]:
    for at, kind, content in _inside(chunk):
        if kind in (Opcode.SCHEMA, Opcode.CHANNEL):
            if len(content) > MOST_HEAD:
                raise Broken(at, f"a record of {len(content)} bytes, expected at most {MOST_HEAD}")
            yield _parse(at, _KINDS[kind], content)


def _inside(data: bytes, start: int = 0) -> Iterator[tuple[int, int, bytes]]:
    """Position, kind and content of the records in a decompressed chunk or an index that begins at `start`."""
    for at, kind, begin, end in _spans(data, start):
        yield at, kind, data[begin:end]


def _spans(data: bytes, start: int = 0) -> Iterator[tuple[int, int, int, int]]:
    """Position in the file and kind of these records, and begin and end of their contents in the data."""
    at, size, whole = 0, _RECORD.size, len(data)
    while at < whole:
        begin = at + size
        kind, length = _RECORD.unpack_from(data, at) if begin <= whole else (0, whole)
        end = begin + length
        if end > whole:
            raise Broken(start + at, "a record is longer than its chunk")
        yield start + at, kind, begin, end
        at = end


def _lz4(data: bytes, size: int) -> bytes:
    """Decompress to `size` bytes at most; the length in the frame is not trusted."""
    unpacker = lz4.frame.LZ4FrameDecompressor()
    unpacked = unpacker.decompress(data, max_length=size + 1)
    if not unpacker.eof:
        raise ValueError("not the size in the chunk's header")
    return unpacked


def _zstd(data: bytes, size: int) -> bytes:
    """Decompress to `size` bytes. The library allocates the length in the frame, so check that first."""
    if zstandard.frame_content_size(data) not in (size, -1):
        raise ValueError("not the size in the chunk's header")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)


_UNPACK: dict[str, tuple[int, Callable[[bytes, int], bytes]]] = {
    "": (1, lambda data, size: data), "zstd": (1 << 15, _zstd), "lz4": (255, _lz4),
}  # fmt: skip
"""By name of the compression: largest compression ratio, and the function that decompresses to a size."""


def _open(at: int, chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    try:
        gain, unpack = _UNPACK[chunk.compression]
        if size > min(MOST, gain * len(chunk.data)):
            raise ValueError(f"{size} bytes, decompressed")
        data = unpack(chunk.data, size)
        if len(data) != size:
            raise ValueError(f"{len(data)} bytes, expected {size}")
    except _BAD:
        raise Broken(at, "a chunk of messages cannot be decompressed") from None
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise Broken(at, "a chunk of messages does not match its checksum")
    return data


def _parse(at: int, kind: Any, content: bytes) -> Any:
    source = BytesIO(content)
    try:
        record = kind.read(ReadDataStream(source))
    except _BAD:
        raise Broken(at, f"a record {kind.__name__} cannot be read") from None
    if source.tell() != len(content):  # a damaged length would hide the records that follow
        raise Broken(at, f"a record {kind.__name__} has a wrong length")
    return record
