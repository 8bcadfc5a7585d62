"""Small files that claim, or unpack to, more than a machine has: refused before the memory is taken."""

import gzip
import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Message, Metadata, MetadataIndex, Schema
from mcap.records import Footer as End

from palpate.physics.archive import ArchiveError, read_arrays
from palpate.records.format.head import SCHEMA_VERSION
from palpate.records.format.mcap_file import LIBRARY, MAGIC, MOST_HEAD, Broken, read_records
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

LIMITED = """
import os, resource, sys
from palpate.physics.errors import PalpateError
{setup}
files = sys.argv[1:]
for path in files:
    if os.fork():  # each in a separate process, which has the imports already
        assert os.wait()[1] == 0
        continue
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        {call}
    except PalpateError as error:
        print(error)
    print("grew by", (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024, "MB", flush=True)
    os._exit(0)
"""


def each_grown(setup: str, call: str, *paths: Path) -> list[tuple[str, int]]:
    """The output of a program for each file, and the growth of its memory [MB]."""
    code = LIMITED.format(setup=setup, call=call)
    done = subprocess.run([sys.executable, "-c", code, *map(str, paths)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    printed: list[tuple[str, int]] = []
    output: list[str] = []
    for line in done.stdout.splitlines():
        if line.startswith("grew by "):
            printed.append(("\n".join(output), int(line.split()[2])))
            output = []
        else:
            output.append(line)
    assert len(printed) == len(paths), done.stdout
    return printed


def grown(setup: str, call: str, path: Path) -> tuple[str, int]:
    """The same of one file."""
    return each_grown(setup, call, path)[0]


def one_chunk(path: Path, compression: str, data: bytes, claimed: int) -> Path:
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, 0, claimed).write(builder)
    path.write_bytes(MAGIC + builder.end())
    return path


@pytest.mark.parametrize("store_size", [True, False])
def test_an_lz4_chunk_unpacks_to_no_more_than_it_claims(tmp_path, store_size):
    packed = lz4.frame.compress(bytes(1 << 27), store_size=store_size)
    path = one_chunk(tmp_path / "a.mcap", "lz4", packed, 1000)
    with pytest.raises(Broken, match="cannot be decompressed"):
        list(read_records(path))
    setup = "from palpate.records.format.mcap_file import Broken, read_records"
    call = "\n        ".join(["try: list(read_records(path))", "except Broken as error: print(error)"])
    output, more = grown(setup, call, path)
    assert "cannot be decompressed" in output and more < 20


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_a_chunk_of_its_declared_size_is_read(tmp_path, compression):
    data = bytes([Opcode.HEADER, *(0,) * 8]) * 500  # records without content
    sized = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstandard.compress}
    unsized = {
        "": bytes,
        "lz4": lambda d: lz4.frame.compress(d, store_size=False),
        "zstd": lambda d: zstandard.ZstdCompressor(write_content_size=False).compress(d),
    }
    for packed in (sized[compression](data), unsized[compression](data)):
        path = one_chunk(tmp_path / "a.mcap", compression, packed, len(data))
        with pytest.raises(Broken, match="ends within"):  # of the file, which has no more
            for chunk in read_records(path):
                assert chunk == data
        for wrong in (len(data) - 1, len(data) + 1):
            path = one_chunk(tmp_path / "a.mcap", compression, packed, wrong)
            with pytest.raises(Broken, match="cannot be decompressed"):
                list(read_records(path))


@pytest.mark.parametrize(
    "kind", [Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.MESSAGE_INDEX, Opcode.METADATA, Opcode.SCHEMA]
)
def test_a_sparse_file_is_not_read_into_memory(tmp_path, kind):
    """A sparse file has the length in its record but needs no disk space."""
    path, length = tmp_path / "hole.mcap", 1 << 33
    path.write_bytes(MAGIC + struct.pack("<BQ", kind, length))
    os.truncate(path, len(MAGIC) + 9 + length)
    output, more = grown(
        "from palpate.records.reader import Recording", "Recording(path)", path
    )  # fmt: skip
    assert "an MCAP file of another program" in output and more < 50


def complete(path: Path, records: list, summary: list) -> Path:
    """A file of these records and an index, whose entries are records or make one from the places of the records."""
    places, data = [], MAGIC
    for record in [Header("palpate", LIBRARY), *records]:
        places.append(len(data))
        builder = RecordBuilder()
        record.write(builder)
        data += builder.end()
    data += struct.pack("<BQI", Opcode.DATA_END, 4, zlib.crc32(data))
    start = len(data)
    builder = RecordBuilder()
    for record in summary:
        (record(places) if callable(record) else record).write(builder)
    index = builder.end()
    head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
    builder = RecordBuilder()
    End(start, 0, zlib.crc32(head, zlib.crc32(index))).write(builder)
    path.write_bytes(data + index + builder.end() + MAGIC)
    return path


def test_metadata_that_the_index_names_a_thousand_times_is_read_once_or_refused(tmp_path):
    about = Metadata("other", {"text": "x" * 1_000_000})
    index = [lambda places: MetadataIndex(places[1], 0, "other")] * 1000
    path = complete(tmp_path / "a.mcap", [about], index)
    output, more = grown("from palpate.records.reader import Recording", "Recording(path)", path)
    assert "not a recording of palpate" in output and more < 100


def test_a_schema_is_parsed_once_for_all_channels_and_not_beyond_its_limit(tmp_path):
    wide = json.dumps({"version": SCHEMA_VERSION, "class": "palpate.messages.contact.Contact", "title": "Contact",
                       "rows": [[]] * 100_000}).encode()  # fmt: skip
    schema = Schema(id=1, data=wide, encoding="jsonschema", name="Contact")
    channels = [Channel(id=k, topic=f"s{k}", message_encoding="msgpack", schema_id=1,
                        metadata={"producer": f"s{k}", "every": "1"}) for k in range(500)]  # fmt: skip
    path = complete(tmp_path / "a.mcap", [], [schema, *channels])
    output, more = grown("from palpate.records.reader import Recording", "Recording(path)", path)
    assert "not a recording of palpate" in output and more < 100
    huge = Schema(id=1, data=b" " * (MOST_HEAD + 1), encoding="jsonschema", name="Contact")
    with pytest.raises(RecordingError, match=r"bytes of streams|expected at most"):
        Recording(complete(tmp_path / "b.mcap", [], [huge]))


@pytest.mark.parametrize("text", ["[" * 200_000, "{", "1" * 10_000])
def test_invalid_json_in_a_recording_is_an_error(tmp_path, text):
    about = Metadata("palpate.about", {"plan": text})
    path = complete(tmp_path / "a.mcap", [about], [lambda places: MetadataIndex(places[1], 0, "palpate.about")])
    with pytest.raises(RecordingError, match=r"palpate\.about|do not match"):
        Recording(path)


def test_a_tick_far_away_takes_no_more_memory_than_one_nearby(tmp_path):
    schema = {"version": SCHEMA_VERSION, "class": "palpate.messages.contact.Contact", "title": "Contact"}
    builder = RecordBuilder()
    Message(channel_id=1, sequence=2**31 - 1, log_time=0, publish_time=0, data=b"").write(builder)
    inside = builder.end()
    records = [
        Schema(id=1, data=json.dumps(schema).encode(), encoding="jsonschema", name="Contact"),
        Channel(id=1, topic="s", message_encoding="msgpack", schema_id=1, metadata={"producer": "s", "every": "1"}),
        Chunk("", inside, 0, 0, 0, len(inside)),
    ]
    path = tmp_path / "a.mcap"
    builder = RecordBuilder()
    for record in [Header("palpate", "none"), Metadata("palpate.about", {"plan": "{}"}), *records]:
        record.write(builder)
    path.write_bytes(MAGIC + builder.end())
    setup = "from palpate.records.reader import Recording"
    output, more = grown(setup, "print(Recording(path).ticks()['s'].tolist())", path)
    assert output == "[2147483647]" and more < 50


def test_a_message_without_its_header_ends_the_reading(tmp_path):
    inside = struct.pack("<BQ", Opcode.MESSAGE, 3) + b"abc"
    path = one_chunk(tmp_path / "a.mcap", "", inside, len(inside))
    with pytest.raises(RecordingError, match=r"without its head|not a recording"):
        list(Recording(path).raw())


def test_an_archive_that_unpacks_beyond_its_limit_is_an_error(tmp_path, monkeypatch):
    """64 MB of zeros lie in an .npz of 64 kB, 4 GB in one of 4 MB."""
    monkeypatch.setattr("palpate.physics.archive.MOST", 1 << 25)
    path = tmp_path / "zeros.npz"
    with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive, archive.open("rows.npy", "w") as file:
        count = 1 << 23
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (count,)})
        for _ in range(count >> 17):
            file.write(bytes(1 << 20))
    assert path.stat().st_size < 100_000
    with pytest.raises(ArchiveError, match="expected at most 33554432"):
        read_arrays(path)


SCANS = """import nibabel, pydicom
from palpate.models.scan import read
sys.modules["palpate.models.scan.read"].MOST_VOXELS = 1 << 24"""


def nifti(begin: float = 352.0, shape=(4, 4, 4)) -> bytearray:
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *shape, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, 2, 8)  # unsigned bytes
    struct.pack_into("<f", head, 108, begin)
    head[344:348] = b"n+1\0"
    return head


def test_a_scan_that_unpacks_beyond_its_limit_is_an_error(tmp_path):
    pytest.importorskip("nibabel", reason="nibabel is not installed (extra scan)")
    pytest.importorskip("pydicom", reason="pydicom is not installed (extra scan)")
    pytest.importorskip("skimage", reason="scikit-image is not installed (extra scan)")
    import phantom_finger as phantom

    from palpate.models.scan.stack import Stack

    wide = tmp_path / "wide.nii.gz"
    with gzip.open(wide, "wb", compresslevel=1) as file:
        file.write(bytes(nifti(shape=(1000, 1000, 60))))
        file.write(bytes(60_000_000))
    long = tmp_path / "long.nii.gz"
    with gzip.open(long, "wb", compresslevel=1) as file:
        head = nifti(begin=6e7)
        head[348:352] = b"\1\0\0\0"
        file.write(bytes(head) + struct.pack("<ii", 60_000_000 - 352, 6))
        file.write(bytes(60_000_000))

    stack = Stack(np.zeros((3, 8, 8), np.float32), (1e-3, 1e-3, 1e-3), "")
    series = phantom.write_dicom(stack, tmp_path / "series")
    import pydicom

    for file in series.iterdir():
        one = pydicom.dcmread(file)
        one.Rows = one.Columns = 65535
        pydicom.dcmwrite(file, one)
    packed = phantom.write_dicom(stack, tmp_path / "packed")
    for file in packed.iterdir():
        one = pydicom.dcmread(file)
        one.PixelData = bytes(40_000_000)
        one.file_meta.TransferSyntaxUID = pydicom.uid.DeflatedExplicitVRLittleEndian
        pydicom.dcmwrite(file, one, enforce_file_format=True)

    words = {
        wide: "60000000 voxels",
        long: "its voxels begin at byte",
        series: "voxels, expected",
        packed: "deflated DICOM",
    }
    for word, (output, more) in zip(words.values(), each_grown(SCANS, "read(path)", *words), strict=True):
        assert word in output and more < 30
