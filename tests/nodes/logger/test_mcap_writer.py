"""The written MCAP file: read by the reference reader, with and without index; truncated at any byte; full disk."""

import errno
import io
import random
import struct
import zlib
from pathlib import Path

import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, ChunkIndex, Message, MessageIndex
from mcap.stream_reader import StreamReader, breakup_chunk

from palpate.nodes.base import Stream
from palpate.nodes.logger import Mcap
from palpate.records.fill import recover
from palpate.records.format.mcap_file import Broken, McapRecords, messages
from palpate.records.format.mcap_writer import CHUNK_SIZE, McapWriter
from palpate.records.reader import Recording

Rows = list[tuple[int, int, int, bytes]]


def rows(count: int, longest: int, seed: int = 0) -> Rows:
    """Channel, tick, time and bytes of messages, not strictly sorted by time."""
    draw = random.Random(seed)
    return [
        (draw.randint(1, 3), k, 1000 * k + draw.randint(0, 3000), draw.randbytes(draw.randint(0, longest)))
        for k in range(count)
    ]


def write(file: io.BufferedIOBase | io.BytesIO, given: Rows, compression="zstd", every: int = 0) -> None:
    """A file of these messages, with `every` messages per chunk."""
    writer = McapWriter(file, "test", compression)
    schema = writer.add_schema("Any", b"{}")
    for name in "abc":
        writer.add_channel(name, "msgpack", schema, {"producer": name})
    writer.add_metadata("first", {"one": "1"})
    for k, row in enumerate(given):
        writer.add_message(row[0], row[1], row[2], row[3])
        if every and not (k + 1) % every:
            writer.close_chunk()
    writer.add_metadata("last", {"two": "2"})
    writer.finish()


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@pytest.mark.parametrize(("count", "longest", "every"), [(0, 1, 0), (1, 0, 0), (500, 300, 7), (40, 200_000, 0)])
def test_the_reference_reader_accepts_every_message_and_checksum(compression, count, longest, every):
    given = rows(count, longest)
    file = io.BytesIO()
    write(file, given, compression, every)
    file.seek(0)
    linear = NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False)
    in_order = [(m.channel_id, m.sequence, m.log_time, m.data) for _, _, m in linear]
    assert in_order == given
    file.seek(0)
    reader = make_reader(file, validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None and summary.statistics is not None
    assert [m.log_time for _, _, m in reader.iter_messages()] == sorted(row[2] for row in given)
    for name, number in (("a", 1), ("b", 2), ("c", 3)):
        mine = sum(row[0] == number for row in given)
        assert len(list(reader.iter_messages(topics=[name]))) == mine
        assert summary.statistics.channel_message_counts.get(number, 0) == mine
    assert summary.statistics.message_count == count and summary.statistics.metadata_count == 2
    times = [row[2] for row in given] or [0]
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (min(times), max(times))
    assert summary.statistics.chunk_count == len(summary.chunk_indexes)
    assert {record.name for record in reader.iter_metadata()} == {"first", "last"}
    assert {channel.topic for channel in summary.channels.values()} == set("abc") and len(summary.schemas) == 1


def test_checksums_of_data_and_summary_are_those_of_the_format():
    """`data_section_crc` covers all bytes before DataEnd, `summary_crc` all from there up to itself."""
    file = io.BytesIO()
    write(file, rows(100, 50), every=9)
    data = file.getvalue()
    summary_start, _, summary_crc = struct.unpack("<QQI", data[-8 - 20 : -8])
    assert summary_crc == zlib.crc32(data[summary_start : -8 - 4])
    kind, length, data_crc = struct.unpack("<BQI", data[summary_start - 13 : summary_start])
    assert (kind, length) == (Opcode.DATA_END, 4) and data_crc == zlib.crc32(data[: summary_start - 13])


def test_every_index_points_to_its_record():
    """Message indexes, chunk indexes and summary offsets, which viewers follow to seek."""
    given = rows(400, 200)
    file = io.BytesIO()
    write(file, given, "none", every=50)
    data = file.getvalue()
    file.seek(0)
    seen = 0
    for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
        if not isinstance(record, ChunkIndex):
            continue
        at = record.chunk_start_offset
        assert data[at] == Opcode.CHUNK and int.from_bytes(data[at + 1 : at + 9], "little") == record.chunk_length - 9
        inside = data[at + record.chunk_length - record.uncompressed_size : at + record.chunk_length]
        end = at + record.chunk_length
        for channel, offset in record.message_index_offsets.items():
            kind, length, number, size = struct.unpack_from("<BQHI", data, offset)
            assert (kind, number, size + 6) == (Opcode.MESSAGE_INDEX, channel, length) and offset == end
            end = offset + 9 + length
            for time, place in struct.iter_unpack("<QQ", data[offset + 15 : end]):
                assert struct.unpack_from("<BQHIQ", inside, place)[::2] == (Opcode.MESSAGE, channel, time)
                seen += 1
        assert end - at - record.chunk_length == record.message_index_length
    assert seen == len(given)
    _, offsets, _ = struct.unpack("<QQI", data[-8 - 20 : -8])
    groups = list(struct.iter_unpack("<BQBQQ", data[offsets : -8 - 29]))
    assert [kind for _, _, kind, _, _ in groups] == [
        Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.METADATA_INDEX,
    ]  # fmt: skip
    for _, _, kind, start, _ in groups:
        assert data[start] == kind
    assert sum(group[4] for group in groups) == offsets - groups[0][3]


def test_a_message_longer_than_a_chunk_is_written():
    given = [(1, 0, 5, bytes(3 * CHUNK_SIZE)), (2, 1, 6, b"x")]
    file = io.BytesIO()
    write(file, given)
    file.seek(0)
    assert [m.data for _, _, m in make_reader(file, validate_crcs=True).iter_messages()] == [row[3] for row in given]


def whole_before(data: bytes, end: int) -> Rows:
    """Contents of the complete chunks before a position, by the reference reader."""
    found, at = [], 8
    while at + 9 <= end:
        length = int.from_bytes(data[at + 1 : at + 9], "little")
        if at + 9 + length > end:
            break
        if data[at] == Opcode.CHUNK:
            chunk = Chunk.read(ReadDataStream(io.BytesIO(data[at + 9 : at + 9 + length])))
            found += [(r.channel_id, r.sequence, r.log_time, r.data)
                      for r in breakup_chunk(chunk) if isinstance(r, Message)]  # fmt: skip
        at += 9 + length
    return found


def test_a_truncated_file_is_read_up_to_its_last_whole_chunk(tmp_path):
    path = tmp_path / "cut.mcap"
    with path.open("wb") as file:
        write(file, rows(12, 40), every=4)
    data = path.read_bytes()
    for end in range(8, len(data) - 1):
        path.write_bytes(data[:end])
        found: Rows = []
        with path.open("rb") as file, pytest.raises(Broken) as broken:
            for record in McapRecords(file):
                if isinstance(record, bytes):
                    found += messages(record)
            McapRecords(file).read_index()
        assert broken.value.cut and found == whole_before(data, end)


def test_recover_completes_a_file_truncated_anywhere(tmp_path):
    """`recover` returns the whole chunks before the cut, for cuts across the file and at the end of each record."""
    from palpate.messages import DeviceState, pack

    path = tmp_path / "run.mcap"
    node = Mcap(path=str(path), within=0.0)
    node.listen((Stream("device", DeviceState, "device", 1),), {"plan": {}})
    node.start()
    for tick in range(30):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=1000 * tick)))
    node.stop()
    data = path.read_bytes()
    begin = data.index(b"msgpack")
    draw = random.Random(1)
    for k, end in enumerate(sorted({len(data) - 1, *(draw.randrange(begin + 200, len(data)) for _ in range(60))})):
        cut = tmp_path / f"{k}.mcap"
        cut.write_bytes(data[:end])
        target, _ = recover(cut)
        again = Recording(target)
        assert again.complete
        assert [(1, *row[1:]) for row in again.raw()] == whole_before(data, end)


class Full(io.FileIO):
    """A disk with space for this number of bytes and, after one failure, for more."""

    room = 50_000
    refused = False

    def write(self, data, /):
        if self.tell() + len(data) > self.room and not self.refused:
            self.refused = True
            super().write(memoryview(data)[: self.room - self.tell()])
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


def test_nothing_is_written_after_a_failed_chunk(tmp_path):
    """A waiting chunk is not written behind the gap of a failed one."""
    path = tmp_path / "full.mcap"
    with Full(path, "wb") as file:
        writer = McapWriter(file, "test", "none")
        writer.add_channel("a", "msgpack", 0, {})
        taken = 0
        with pytest.raises(OSError, match="No space"):
            for tick in range(1000):
                writer.add_message(1, tick, tick, bytes(1000))
                taken = tick
                if tick % 10 == 9:
                    writer.close_chunk()
        with pytest.raises(OSError, match="No space"):
            writer.flush()
        writer.close()
    assert path.stat().st_size == Full.room and taken < 200
    with path.open("rb") as opened:
        ticks = [tick for _, chunk in McapRecords(opened).chunks() for _, tick, _, _ in messages(chunk)]
    assert ticks == list(range(len(ticks))) and len(ticks) >= 40


def test_an_index_has_an_entry_for_each_channel_of_its_chunk():
    file = io.BytesIO()
    write(file, rows(90, 10), every=30)
    file.seek(0)
    channels = [r.channel_id for r in StreamReader(file, emit_chunks=True).records if isinstance(r, MessageIndex)]
    assert channels == [1, 2, 3] * 3


def test_the_file_is_complete_after_flush(tmp_path: Path):
    """`flush` returns when all data is in the file, for any reader."""
    path = tmp_path / "a.mcap"
    with path.open("wb", buffering=CHUNK_SIZE) as file:
        writer = McapWriter(file, "test")
        writer.add_channel("a", "msgpack", 0, {})
        for tick in range(10):
            writer.add_message(1, tick, tick, b"x")
            writer.flush()
            with path.open("rb") as opened:
                assert [t for _, c in McapRecords(opened).chunks() for _, t, _, _ in messages(c)] == [*range(tick + 1)]
        writer.finish()
