"""The records of a recording, an MCAP file (https://mcap.dev), each verified against its checksum.

MCAP has checksums of what is in a chunk (messages, and the schemas and channels before them), of attachments, of the
summary at the end, and of all data of a complete file. Metadata have none of their own, which a file that was cut off
would need: they are sealed with one more key.
"""

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, Metadata, MetadataIndex, Schema

from palpate.records.format.mcap_writer import LIBRARY, MAGIC, SEAL, seal

_RECORD = struct.Struct("<BQ")
_HEAD = struct.Struct("<HIQQ")  # of a message: channel, sequence number, which is its tick, and two times
_FOOTER = _RECORD.size + 20 + len(MAGIC)
_DATA_END = _RECORD.size + 4
_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex, Opcode.CHUNK: Chunk, Opcode.FOOTER: Footer,
}  # fmt: skip
_IN_DATA = {Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT,
            Opcode.METADATA}  # fmt: skip
# What the libraries raise on bytes that are not what they should be; lz4 has RuntimeError alone.
_BAD = (McapError, EOFError, ValueError, RuntimeError, KeyError, TypeError, MemoryError, OverflowError, struct.error,
        zstandard.ZstdError)  # fmt: skip
BLOCK = 1 << 20
MOST = 1 << 28
"""[bytes] Largest chunk, packed or unpacked, and largest index at the end; a logger begins a new chunk long before, and
fills such an index in 50 hours."""
MOST_HEAD = 1 << 24
"""[bytes] Largest record of what a file says of its streams and its run, and all of them together: 100 times what the
largest graph that ships takes. They are read as JSON, which takes up to 30 times as much memory."""


def lacking(path: Path) -> str:
    """What a recording lacks, in one line: its end, or messages that its logger did not get; empty for a whole one."""
    try:
        with path.open("rb") as file:
            told = [record for record in Records(file).indexed() if isinstance(record, Metadata)]
    except (OSError, Broken) as error:
        return f"recording {path} is not complete: {error}"
    counts = {
        name: entry for record in told if record.name == "palpate.counts" for name, entry in record.metadata.items()
    }
    lost = {name: json.loads(entry)["lost"] for name, entry in counts.items()}
    losses = ", ".join(f"{name} {number}" for name, number in lost.items() if number)
    return f"recording {path} lacks messages that did not reach it in time: {losses}" if losses else ""


class Broken(Exception):
    """Bytes of a file that are missing or not what was written, and from which on nothing can be relied on.

    at   the byte where it begins
    cut  nothing comes after it: the file was cut off
    """

    def __init__(self, at: int, what: str, cut: bool = False) -> None:
        super().__init__(f"{'cut off' if cut else 'damaged'} at byte {at}: {what}")
        self.at, self.cut = at, cut


class Records:
    """The records of one file, in its order: headers, schemas, channels, metadata and opened chunks.

    Broken is raised where the file is cut off or damaged; what came before it is good.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self.file = file
        self.size = os.fstat(file.fileno()).st_size
        self.is_sealed = False

    def __iter__(self) -> Iterator[Header | Schema | Channel | Metadata | bytes]:
        """Records from the beginning up to the end of the data; a chunk as the bytes of the records in it."""
        self.file.seek(0)
        if self.file.read(len(MAGIC)) != MAGIC:
            raise Broken(0, "this is no MCAP file")
        for at, kind in self._places():
            if kind not in _IN_DATA:
                raise Broken(at, f"found a record of kind {kind}, which does not belong here")
            if kind == Opcode.CHUNK:
                yield self.chunk(at)
            elif kind in _KINDS:
                yield self._checked(at, _parse(at, _KINDS[kind], self._record(at)[1]))
            elif kind == Opcode.MESSAGE_INDEX:
                self._check_index(at)

    def chunks(self) -> Iterator[tuple[int, bytes]]:
        """Where each chunk begins, and what is in it, as far as the file is good."""
        try:
            for at, kind in self._places():
                if kind == Opcode.CHUNK:
                    yield at, self.chunk(at)
        except Broken:
            return

    def chunk(self, at: int) -> bytes:
        """What is in the chunk that begins there."""
        return _open(at, _parse(at, Chunk, self._record(at)[1]))

    def _places(self) -> Iterator[tuple[int, int]]:
        """Where each record begins, and its kind, up to the end of the data; nothing of it is read yet."""
        at = len(MAGIC)
        while True:
            kind, length = self._about(at)
            if kind == Opcode.DATA_END:
                return
            yield at, kind
            at += _RECORD.size + length

    def indexed(self) -> list[Schema | Channel | Metadata]:
        """Schemas, channels and metadata of a complete file, by the summary at its end. Broken: the file is not
        complete, or not as it was written, wherever in it."""
        self._checked(len(MAGIC), _parse(len(MAGIC), Header, self._record(len(MAGIC))[1]))
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
                records.append(self._checked(place, _parse(place, Metadata, content)))
            elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                records.append(_parse(at, _KINDS[kind], content))
            else:
                continue
            read += len(content)  # indices may name one record many times
            if read > MOST_HEAD:
                raise Broken(at, f"more than {MOST_HEAD} bytes of streams and metadata")
        return records

    def _summary(self) -> tuple[int, int]:
        """Where the summary begins, and its checksum."""
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
        """Compare all data with their checksum, where there is one; `end` is where the summary begins."""
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
        if length > most:  # a file may be as long as it says and hold nothing but a hole
            raise Broken(at, f"a record of {length} bytes, expected at most {most}")
        return kind, self._bytes(at + _RECORD.size, length)

    def _about(self, at: int) -> tuple[int, int]:
        """Kind and length of a record that the file holds to its end."""
        kind, length = _RECORD.unpack(self._bytes(at, _RECORD.size))
        if at + _RECORD.size + length > self.size:
            raise Broken(at, "the file ends within this record", cut=True)
        return kind, length

    def _check_index(self, at: int) -> None:
        """Broken: an index of messages has another length than it says (a chunk, one bit off)."""
        _, length = self._about(at)
        said = self._bytes(at + _RECORD.size, min(length, 6))
        if length != 6 + int.from_bytes(said[2:], "little"):
            raise Broken(at, "an index of messages has another length than it says")

    def _bytes(self, at: int, length: int) -> bytes:
        if at < 0 or at + length > self.size:
            raise Broken(at, "the file ends within this record", cut=True)
        self.file.seek(at)
        return self.file.read(length)

    def _checked(self, at: int, record: Any) -> Any:
        """The record; metadata without their seal. Broken: it does not match."""
        if isinstance(record, Header):
            self.is_sealed = record.library == LIBRARY
        elif isinstance(record, Metadata):
            found = record.metadata.pop(SEAL, None)
            if found != seal(record.name, record.metadata) and (found is not None or self.is_sealed):
                raise Broken(at, f"metadata {record.name!r} do not match their checksum")
        return record


def opened(path: str | Path) -> Iterator[Header | Schema | Channel | Metadata | bytes]:
    """The records of a file as `Records` gives them. OSError, Broken."""
    with open(path, "rb") as file:
        yield from Records(file)


def messages(chunk: bytes) -> Iterator[tuple[int, int, int, bytes]]:
    """Channel, tick, time [ns] and wire bytes of the messages in an opened chunk."""
    for at, kind, content in _inside(chunk):
        if kind == Opcode.MESSAGE:
            if len(content) < _HEAD.size:
                raise Broken(at, "a message without its head")
            channel, tick, time, _ = _HEAD.unpack_from(content)
            yield channel, tick, time, content[_HEAD.size :]


def declared(chunk: bytes) -> Iterator[Schema | Channel]:
    """The schemas and channels in an opened chunk."""
    for at, kind, content in _inside(chunk):
        if kind in (Opcode.SCHEMA, Opcode.CHANNEL):
            if len(content) > MOST_HEAD:
                raise Broken(at, f"a record of {len(content)} bytes, expected at most {MOST_HEAD}")
            yield _parse(at, _KINDS[kind], content)


def _inside(data: bytes, start: int = 0) -> Iterator[tuple[int, int, bytes]]:
    """Place, kind and content of the records in an opened chunk or an index; `start` is where that begins."""
    at = 0
    while at < len(data):
        end = at + _RECORD.size
        kind, length = _RECORD.unpack_from(data, at) if end <= len(data) else (0, len(data))
        if end + length > len(data):
            raise Broken(start + at, "a record ends beyond what it lies in")
        yield start + at, kind, data[end : end + length]
        at = end + length


def _lz4(data: bytes, size: int) -> bytes:
    """Of no more than `size` bytes; the length that a frame states, if any, is not relied on."""
    unpacker = lz4.frame.LZ4FrameDecompressor()
    unpacked = unpacker.decompress(data, max_length=size + 1)
    if not unpacker.eof:
        raise ValueError("more bytes than the chunk says, or fewer")
    return unpacked


def _zstd(data: bytes, size: int) -> bytes:
    """The library reserves memory by the length that a frame states."""
    if zstandard.frame_content_size(data) not in (size, -1):
        raise ValueError("another length than the chunk says")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)


_UNPACK: dict[str, tuple[int, Callable[[bytes, int], bytes]]] = {
    "": (1, lambda data, size: data), "zstd": (1 << 15, _zstd), "lz4": (255, _lz4),
}  # fmt: skip
"""By the name of a compression the bytes out of one of it, at most, and what unpacks them, given their number."""


def _open(at: int, chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    try:
        gain, unpack = _UNPACK[chunk.compression]
        if size > min(MOST, gain * len(chunk.data)):
            raise ValueError(f"{size} bytes, unpacked")
        data = unpack(chunk.data, size)
        if len(data) != size:
            raise ValueError(f"{len(data)} bytes, expected {size}")
    except _BAD:
        raise Broken(at, "a chunk of messages cannot be unpacked") from None
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise Broken(at, "a chunk of messages does not match its checksum")
    return data


def _parse(at: int, kind: Any, content: bytes) -> Any:
    source = BytesIO(content)
    try:
        record = kind.read(ReadDataStream(source))
    except _BAD:
        raise Broken(at, f"a record {kind.__name__} cannot be read") from None
    if source.tell() != len(content):  # its length is damaged: it would swallow what follows
        raise Broken(at, f"a record {kind.__name__} is not as long as it says")
    return record
