"""Adds metadata to the end of a complete MCAP file, which has been closed."""

import struct
import zlib
from contextlib import suppress
from pathlib import Path

from mcap import records
from mcap.opcode import Opcode

from palpate.records.format.mcap_writer import MAGIC, SEAL, record_bytes, seal

NOTES = "palpate.notes"
"""Name of the metadata with the lines for the user about a run: a JSON list of text, node and time [s]."""

_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_FOOTER = struct.Struct("<QQI")  # begin of the summary and of its offsets, checksum
_END, _TAIL = _HEAD.size + 4, _HEAD.size + _FOOTER.size + len(MAGIC)  # [bytes] of DataEnd, and after the summary
_COUNT = 18  # [bytes] in Statistics before the number of metadata records
MOST = 1 << 28  # [bytes] Largest summary


def append_metadata(path: Path, name: str, data: dict[str, str]) -> None:
    """Write metadata with their checksum after the messages of a file.

    OSError: it cannot be written; the file is as before. ValueError: it is not complete.
    """
    with open(path, "r+b") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _TAIL))
        tail = file.read()
        if len(tail) < _TAIL or tail[0] != Opcode.FOOTER or not tail.endswith(MAGIC):
            raise ValueError(f"{path}: found no end of a recording")
        start = _FOOTER.unpack_from(tail, _HEAD.size)[0] - _END
        if not 0 < start < size or size - start > MOST:
            raise ValueError(f"{path}: found no summary of a recording")
        file.seek(start)
        former = file.read()
        record = record_bytes(records.Metadata(name, {**data, SEAL: seal(name, data)}))
        index = record_bytes(records.MetadataIndex(start, len(record), name))
        checksum = zlib.crc32(record, struct.unpack_from("<I", former, _HEAD.size)[0])
        made = record + record_bytes(records.DataEnd(checksum))
        made += _summary(former[_END:-_TAIL], index, start + len(made))
        file.seek(start)
        try:
            file.write(made)
            file.flush()
            file.truncate()
        except OSError:
            with suppress(OSError):
                file.seek(start)
                file.write(former)
                file.truncate()
            raise


def _summary(former: bytes, index: bytes, start: int) -> bytes:
    """The summary with one more metadata record, from byte `start` on, and all that follows it."""
    groups: dict[int, bytes] = {}
    at = 0
    while at < len(former):
        kind, length = _HEAD.unpack_from(former, at)
        if kind != Opcode.SUMMARY_OFFSET:
            groups[kind] = groups.get(kind, b"") + former[at : at + _HEAD.size + length]
        at += _HEAD.size + length
    statistics = bytearray(groups[Opcode.STATISTICS])
    (count,) = struct.unpack_from("<I", statistics, _HEAD.size + _COUNT)
    struct.pack_into("<I", statistics, _HEAD.size + _COUNT, count + 1)
    groups[Opcode.STATISTICS] = bytes(statistics)
    groups[Opcode.METADATA_INDEX] = groups.get(Opcode.METADATA_INDEX, b"") + index
    summary, offsets = b"", b""
    for kind, packed in groups.items():
        offsets += record_bytes(records.SummaryOffset(kind, start + len(summary), len(packed)))
        summary += packed
    footer = record_bytes(records.Footer(start, start + len(summary), 0))[:-4]
    checksum = zlib.crc32(footer, zlib.crc32(summary + offsets))
    return summary + offsets + footer + checksum.to_bytes(4, "little") + MAGIC
