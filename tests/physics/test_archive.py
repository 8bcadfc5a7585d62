"""Archives of arrays: round trips; damaged archives and excessive sizes are errors."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest

from palpate.physics.archive import ArchiveError, read_arrays


def test_arrays_survive_a_round_trip(tmp_path):
    path = tmp_path / "a.npz"
    arrays = {
        "rows": np.arange(12.0).reshape(3, 4),
        "columns": np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3)),
        "none": np.zeros((0, 3), dtype=np.float32),
        "text": np.array("word"),
        "one": np.array(2.5),
    }
    for write in (np.savez, np.savez_compressed):
        write(path, **arrays)
        again = read_arrays(path)
        assert again.keys() == arrays.keys()
        for name, array in arrays.items():
            assert again[name].dtype == array.dtype
            np.testing.assert_array_equal(again[name], array)
    assert read_arrays(path, "one", "other").keys() == {"one"}


def claiming(path, header: bytes, data: bytes = b"") -> None:
    """Write an archive with one array with this header."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("rows.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data)


def test_no_array_is_allocated_by_a_claimed_length(tmp_path):
    """numpy's reader allocates the array first: 8 GB for a file of a few hundred bytes."""
    claiming(tmp_path / "a.npz", b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000,)}")
    tracemalloc.start()
    with pytest.raises(ArchiveError, match=r"a\.npz"):
        read_arrays(tmp_path / "a.npz")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 10_000_000


def test_pickled_objects_are_refused_and_not_run(tmp_path):
    class Runs:
        def __reduce__(self):
            return (open, (str(tmp_path / "was run"), "w"))

    path = tmp_path / "a.npz"
    np.savez(path, rows=np.array([Runs()], dtype=object))
    with pytest.raises(ArchiveError, match="objects"):
        read_arrays(path)
    assert not (tmp_path / "was run").exists()


def test_an_archive_with_too_large_a_size_is_rejected_before_reading(tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.physics.archive.MOST", 1000)
    np.savez_compressed(tmp_path / "a.npz", rows=np.zeros(1000))
    with pytest.raises(ArchiveError, match="8128 bytes unpacked, expected at most 1000"):
        read_arrays(tmp_path / "a.npz")


def test_an_array_is_read_without_a_copy(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", rows=np.zeros(4_000_000))
    tracemalloc.start()
    assert read_arrays(tmp_path / "a.npz")["rows"].nbytes == 32_000_000
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 40_000_000


@pytest.mark.parametrize("what", ["nothing", "text", "an array", "a folder", "no file"])
def test_a_file_that_is_not_an_archive_is_an_error(tmp_path, what):
    path = tmp_path / "a.npz"
    single = io.BytesIO()
    np.save(single, np.zeros(3))
    if what == "a folder":
        path.mkdir()
    elif what != "no file":
        path.write_bytes({"nothing": b"", "text": b"words", "an array": single.getvalue()}[what])
    with pytest.raises(ArchiveError, match=r"a\.npz: cannot be read as \.npz"):
        read_arrays(path)
