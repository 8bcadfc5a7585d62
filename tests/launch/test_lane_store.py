"""Ensembles in blocks of lanes, and their results in a zarr store."""

import json
import os
import resource
import subprocess
import sys
import time
import traceback
import warnings

import numpy as np
import pytest
from expected_notes import ENERGY, STIFF

import palpate
from palpate.launch.run import lane_blocks
from palpate.physics.errors import ArgumentError, RunError
from palpate.records.lane_store import KeptField, LaneStore

xarray = pytest.importorskip("xarray")
pytest.importorskip("zarr")

STIFFNESS = np.linspace(150.0, 350.0, 11)
GIVEN = {"duration": 0.05, "every": 5, "sets": ("scene.hand.begin=[0, 0, 0.1085]",), "tissue": "deformation.MassSpring"}


def touches(keep=("contact.force", "controller.force"), over=None, lanes=11, **given):
    return palpate.Ensemble(
        "kidney", lanes, {"tissue.stiffness": STIFFNESS} if over is None else over, keep, **GIVEN | given
    )


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(lane_blocks, "LANES", 4)


@pytest.mark.notes(STIFF)
def test_blocks_of_any_size_give_the_same_results(monkeypatch):
    over = {"tissue.stiffness": STIFFNESS, "controller.mass": np.linspace(0.004, 0.1, 11)}
    asked = touches(over=over)
    whole = asked.run(quiet=True)
    assert whole["contact.force"].values[:, -1].min() > 0.0 and len({note.text for note in asked.notes}) > 1
    for most in (1, 3, 4, 10):
        monkeypatch.setattr(lane_blocks, "LANES", most)
        other = touches(over=over)
        assert other.run(quiet=True).identical(whole) and other.notes == asked.notes


@pytest.mark.notes(ENERGY, STIFF)
def test_a_store_is_read_by_xarray_and_has_the_same_results(tmp_path, small_blocks):
    asked = touches(over={"tissue.stiffness": STIFFNESS, "friction.mu_slide": 0.4})
    whole, stored = asked.run(quiet=True), asked.run(out=tmp_path / "t.zarr", quiet=True)
    again = xarray.open_zarr(tmp_path / "t.zarr", consolidated=False, chunks=None)
    for data in (stored, again):
        assert set(data.coords) == set(whole.coords) and set(data.data_vars) == set(whole.data_vars)
        for name in (*whole.data_vars, *whole.coords):
            assert np.array_equal(data[name].values, whole[name].values), name
            assert data[name].attrs.get("units") == whole[name].attrs.get("units")
        assert data["controller.force"].dims == ("lane", "time", "axis")


@pytest.mark.notes(STIFF)
def test_an_interrupted_run_keeps_whole_blocks_and_continues(tmp_path, small_blocks, monkeypatch):
    whole, ran = touches().run(quiet=True), []
    run = lane_blocks.LaneRunner.run

    def interrupted(self, *given):
        ran.append(self)
        if len(ran) == 2:
            raise KeyboardInterrupt
        return run(self, *given)

    monkeypatch.setattr(lane_blocks.LaneRunner, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        touches().run(out=tmp_path / "t.zarr", quiet=True)
    part = xarray.open_zarr(tmp_path / "t.zarr", consolidated=False, chunks=None)
    assert part.attrs["lanes_done"] == [[0, 4]]
    assert np.isnan(part["contact.force"].values[4:]).all() and not np.isnan(part["contact.force"].values[:4]).any()
    asked = touches()
    ended = asked.run(out=tmp_path / "t.zarr", quiet=True)
    assert len(ran) == 4  # one whole block, the interrupted one, two more
    assert {note.lane for note in asked.notes} == set(range(11))  # also of the block that ran before
    assert ended["notes"].values.tolist() == whole["notes"].values.tolist()
    assert np.array_equal(ended["contact.force"].values, whole["contact.force"].values)
    ran.clear()
    touches().run(out=tmp_path / "t.zarr", quiet=True)
    assert not ran


def spoiled(folder, name):
    """Each way in which the files of a block may be damaged: what is done to the file of the middle block."""
    file = folder / name / "c" / "1"
    file = file if file.is_file() else next(each for each in file.rglob("*") if each.is_file())
    content = file.read_bytes()
    yield "removed", file.unlink
    yield "cut", lambda: file.write_bytes(content[: len(content) // 2])
    yield "empty", lambda: file.write_bytes(b"")
    yield "changed", lambda: file.write_bytes(content[:-3] + bytes([content[-3] ^ 1]) + content[-2:])
    yield "longer", lambda: file.write_bytes(content + b"x")
    yield "of another block", lambda: file.write_bytes(next(
        each for each in (folder / name / "c").rglob("*") if each.is_file() and each != file
    ).read_bytes())  # fmt: skip


@pytest.mark.parametrize("name", ["contact.force", "controller.force", "notes"])
@pytest.mark.notes(STIFF)
def test_blocks_whose_files_were_damaged_are_computed_again(tmp_path, small_blocks, monkeypatch, name):
    """The call returned at once, and the array had other numbers: fill values for a missing file."""
    folder, ran = tmp_path / "t.zarr", []
    whole = touches().run(out=folder, quiet=True).load()
    files = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    run = lane_blocks.LaneRunner.run
    monkeypatch.setattr(lane_blocks.LaneRunner, "run", lambda self, *given: ran.append(self) or run(self, *given))
    ways = [way for way, _ in spoiled(folder, name)]
    assert len(ways) == 6
    for way in ways:
        dict(spoiled(folder, name))[way]()
        with pytest.warns(
            RuntimeWarning, match=r"1 of 3 blocks of lanes, the first at lane 4, were changed or removed"
        ):
            again = touches().run(out=folder, quiet=True)
        assert len(ran) == 1, way
        ran.clear()
        assert again.load().identical(whole), way
        assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == files, way
    assert touches().run(out=folder, quiet=True).load().identical(whole) and not ran


@pytest.mark.parametrize("name", ["time", "lane", "tissue.stiffness"])
@pytest.mark.notes(STIFF)
def test_a_store_with_damaged_coordinates_is_refused(tmp_path, small_blocks, name):
    touches().run(out=tmp_path / "t.zarr", quiet=True)
    next(each for each in (tmp_path / "t.zarr" / name / "c").rglob("*") if each.is_file()).unlink()
    with pytest.raises(
        ArgumentError, match=r"the files of its coordinates were changed or removed.* Remove the folder"
    ):
        touches().run(out=tmp_path / "t.zarr", quiet=True)


@pytest.mark.notes(STIFF)
def test_a_full_disk_is_one_line_and_loses_no_block(tmp_path, small_blocks):
    """It was a traceback of zarr without the path of the store."""
    touches().run(out=tmp_path / "whole.zarr", quiet=True)
    whole = [file for file in sorted((tmp_path / "whole.zarr").rglob("*")) if file.is_file()]
    sizes = sorted({file.stat().st_size for file in whole}, reverse=True)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for limit in (10, 400, sizes[0] - 1, sizes[1] - 1):  # at the creation of the store, and of a block
        with pytest.raises(RunError, match=r"t\.zarr: File too large\. Whole blocks of lanes stay\. Run it again"):
            try:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
                touches().run(out=tmp_path / "t.zarr", quiet=True)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    touches().run(out=tmp_path / "t.zarr", quiet=True)
    for file in whole:
        assert (tmp_path / "t.zarr" / file.relative_to(tmp_path / "whole.zarr")).read_bytes() == file.read_bytes()


@pytest.mark.notes(STIFF)
def test_a_store_whose_creation_was_killed_is_created_again(tmp_path, monkeypatch):
    whole = touches().run(quiet=True)

    def killed(*given):
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr("palpate.records.lane_store.as_coordinate", killed)
        with pytest.raises(MemoryError):
            touches().run(out=tmp_path / "t.zarr", quiet=True)
    assert "lanes_done" not in (tmp_path / "t.zarr" / "zarr.json").read_text()
    (tmp_path / "t.zarr" / "error" / "zarr.0.partial").touch()
    ended = touches().run(out=tmp_path / "t.zarr", quiet=True)
    assert np.array_equal(ended["contact.force"].values, whole["contact.force"].values)
    assert not list((tmp_path / "t.zarr").rglob("*.partial"))


KILLED = """
import sys, warnings
sys.path[:0] = sys.argv[3:]
from test_lane_store import run_blocks
warnings.simplefilter("ignore")
run_blocks(sys.argv[1], *map(int, sys.argv[2].split("x")))
"""


def run_blocks(out, lanes, size):
    """Fill a store in blocks of this size."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(lane_blocks, "LANES", size)
        touches(over={"tissue.stiffness": np.linspace(150.0, 350.0, lanes)}, lanes=lanes).run(out=out, quiet=True)


COLUMNS = [np.arange(55.0).reshape(11, 5), np.arange(55).reshape(11, 5) % 3]
FIELDS = [
    KeptField("contact.force", np.dtype(float), (5,), "N"),
    KeptField("controller.state", np.dtype("i8"), (5,), "", ("free", "contact", "limit")),
]
SYSTEM_CALLS = ("replace", "mkdir", "unlink", "link")


def store_blocks(path, ended=None):
    """Write all missing blocks of a store; without palpate's code or a system call after the one numbered `ended`."""
    count = 0

    def counted(call):
        def wrapper(*args, **given):
            nonlocal count
            if count == ended:
                os._exit(9)
            count += 1
            return call(*args, **given)

        return wrapper

    for name in SYSTEM_CALLS:
        setattr(os, name, counted(getattr(os, name)))
    settings = {"tissue.stiffness": (STIFFNESS, "N/m"), "tissue.use": (["MassSpring"] * 11, "")}
    store, written = LaneStore(path, "same", 11, 4, np.arange(5) * 1e-3, FIELDS, settings, "kidney"), []
    for first in store.missing:
        part = slice(first, first + 4)
        errors, notes = {first + 1: "it failed"}, {first: "contact: a note", first + 2: "contact: another one"}
        store.write(first, [column[part] for column in COLUMNS], errors, notes)
        written.append(first)
    store.close()
    return count, written


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
@pytest.mark.parametrize("each", [4, pytest.param(1, marks=pytest.mark.long)])
def test_a_store_whose_run_was_killed_at_any_write_is_continued_to_the_same_bytes(tmp_path, each):
    """Each run is a process that ends without cleaning up before the nth change of the file system."""

    def run(path, ended):
        read, write = os.pipe()
        child = os.fork()
        if not child:
            try:
                os.write(write, json.dumps(store_blocks(path, ended)).encode())
                os._exit(0)
            finally:
                traceback.print_exc()
                os._exit(1)
        os.close(write)
        _, status = os.waitpid(child, 0)
        with os.fdopen(read, "rb") as pipe:
            return os.waitstatus_to_exitcode(status), pipe.read()

    def content(path):
        return {str(f.relative_to(path)): f.read_bytes() for f in path.rglob("*") if f.is_file()}

    code, answer = run(tmp_path / "whole", None)
    changes, written = json.loads(answer)
    assert code == 0 and changes > 40 and written == [0, 4, 8]
    whole, again = content(tmp_path / "whole"), []
    for ended in range(1, changes, each):
        assert run(tmp_path / str(ended), ended)[0] == 9
        code, answer = run(tmp_path / str(ended), None)
        assert code == 0 and content(tmp_path / str(ended)) == whole, ended
        again.append(len(json.loads(answer)[1]))
    assert again == sorted(again, reverse=True) and set(again) >= {1, 2, 3}  # only missing blocks are written


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGKILL")
@pytest.mark.parametrize(
    ("lanes", "size"), [(120, 3), pytest.param(100_000, 2048, marks=[pytest.mark.long, pytest.mark.timeout(3000)])]
)
@pytest.mark.filterwarnings("ignore:Object at palpate.lock")  # by zarr, which lists what it does not know
@pytest.mark.notes(STIFF)
def test_a_killed_run_continues_with_the_same_bytes(tmp_path, lanes, size):
    def written(name):
        return {
            str(file.relative_to(tmp_path / name)): file.read_bytes()
            for file in (tmp_path / name).rglob("*")
            if file.is_file()
        }

    run = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path / "parts"), f"{lanes}x{size}", *sys.path])
    while sum(file.is_file() for file in (tmp_path / "parts" / "contact.force" / "c").rglob("*")) < 3:
        assert run.poll() is None
        time.sleep(0.01)
    run.kill()
    run.wait()
    done = xarray.open_zarr(tmp_path / "parts", consolidated=False, chunks=None).attrs["lanes_done"]
    assert 0 < done[0][1] < lanes
    for name in ("parts", "whole"):
        run_blocks(tmp_path / name, lanes, size)
    assert written("parts") == written("whole")


@pytest.mark.parametrize("changed", [{"every": 1}, {"keep": ["contact.force"]}, {"over": {"tissue.stiffness": 200.0}},
                                     {"duration": 0.06}, {"finger": {"finger_damping": 9.0}}])  # fmt: skip
@pytest.mark.notes(STIFF)
def test_a_store_of_another_ensemble_is_refused(tmp_path, changed):
    touches().run(out=tmp_path / "t.zarr", quiet=True)
    if "finger" in changed:
        changed = {"sets": (*GIVEN["sets"], "scene.finger.finger_damping=9")}
    with pytest.raises(ArgumentError, match="has results of other settings"):
        touches(**changed).run(out=tmp_path / "t.zarr", quiet=True)


def test_other_files_and_a_store_in_use_are_refused(tmp_path, monkeypatch):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ArgumentError, match="found other files in"):
        touches().run(out=tmp_path, quiet=True)
    assert (tmp_path / "notes.txt").read_text() == "mine" and len(list(tmp_path.iterdir())) == 1
    with pytest.raises(ArgumentError, match="cannot be written: Not a directory"):
        touches().run(out=tmp_path / "notes.txt" / "t.zarr", quiet=True)
    monkeypatch.setattr("palpate.physics.writable.lock_file", lambda file: False)
    with pytest.raises(ArgumentError, match="another run writes to"):
        touches().run(out=tmp_path / "t.zarr", quiet=True)


def test_a_refused_lane_of_a_later_block_is_reported_and_the_others_finish(tmp_path, small_blocks):
    stiffness = STIFFNESS.copy()
    stiffness[[6, 10]] = -1.0
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        data = touches(over={"tissue.stiffness": stiffness}).run(out=tmp_path / "t.zarr", quiet=True)
    bad = np.isin(np.arange(11), [6, 10])
    assert np.isnan(data["contact.force"].values[bad]).all() and not np.isnan(data["contact.force"].values[~bad]).any()
    assert ["stiffness" in text for text in data["error"].values] == bad.tolist()
    assert any("2 of 11 lanes failed" in str(each.message) and "lane 6" in str(each.message) for each in caught)
    with pytest.raises(palpate.PalpateError, match="lane 2"):  # of the first block: an error before anything runs
        touches(over={"tissue.stiffness": [*STIFFNESS[:2], -1.0, *STIFFNESS[3:]]})


@pytest.mark.notes(STIFF)
def test_words_are_stored_as_words(tmp_path):
    asked = touches(keep=["controller.state"])
    whole, stored = asked.run(quiet=True), asked.run(out=tmp_path / "t.zarr", quiet=True)
    assert set(stored["controller.state"].values.ravel()) <= {"free", "contact"}
    assert stored["controller.state"].values.tolist() == whole["controller.state"].values.tolist()


MEASURED = """
import sys, warnings, numpy as np, palpate

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

warnings.simplefilter("ignore")
used, stated = [], []
for lanes in (20, 20, 2020):  # the first run also loads kernels and meshes
    over = {"scene.finger.finger_damping": np.linspace(6.0, 10.0, lanes)}
    asked = palpate.Ensemble("kidney", lanes, over, duration=0.01, sets=["scene.hand.begin=[0, 0, 0.1085]"],
                             tissue=f"deformation.{sys.argv[1]}")
    data = asked.run(quiet=True)
    used.append(resident())
    stated.append(sum(asked.memory))
print((used[2] - used[1]) / 2000, (stated[2] - stated[1]) / 2000)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(("body", "most"), [("MassSpring", 20e3), ("ReducedFE", 45e3)])
def test_the_memory_that_is_stated_is_the_memory_that_is_used(body, most):
    """In a separate process, whose memory no other test has used before. With one arena: what glibc keeps free in one
    for each thread, up to 6 kB per lane here, depends on the order of the threads."""
    environment = {**os.environ, "MALLOC_ARENA_MAX": "1"}
    words = [sys.executable, "-c", MEASURED, body]
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
    used, stated = map(float, done.stdout.split())
    assert used < most and 0.5 * stated < used < 2.0 * stated + 5e3, (used, stated)
