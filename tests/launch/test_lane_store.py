"""Ensembles in blocks of lanes, and their results in a zarr store."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

import palpate
from palpate.launch.run import lane_blocks
from palpate.physics.errors import ArgumentError

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


def test_blocks_of_any_size_give_the_same_results(monkeypatch):
    over = {"tissue.stiffness": STIFFNESS, "controller.mass": np.linspace(0.004, 0.1, 11)}
    asked = touches(over=over)
    whole = asked.run(quiet=True)
    assert whole["contact.force"].values[:, -1].min() > 0.0 and len({note.text for note in asked.notes}) > 1
    for most in (1, 3, 4, 10):
        monkeypatch.setattr(lane_blocks, "LANES", most)
        other = touches(over=over)
        assert other.run(quiet=True).identical(whole) and other.notes == asked.notes


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


def test_an_interrupted_run_keeps_whole_blocks_and_continues(tmp_path, small_blocks, monkeypatch):
    whole, ran = touches().run(quiet=True), []
    run = lane_blocks.LaneRun.run

    def interrupted(self, *given):
        ran.append(self)
        if len(ran) == 2:
            raise KeyboardInterrupt
        return run(self, *given)

    monkeypatch.setattr(lane_blocks.LaneRun, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        touches().run(out=tmp_path / "t.zarr", quiet=True)
    part = xarray.open_zarr(tmp_path / "t.zarr", consolidated=False, chunks=None)
    assert part.attrs["lanes_done"] == [[0, 4]]
    assert np.isnan(part["contact.force"].values[4:]).all() and not np.isnan(part["contact.force"].values[:4]).any()
    ended = touches().run(out=tmp_path / "t.zarr", quiet=True)
    assert len(ran) == 4  # one whole block, the interrupted one, two more
    assert np.array_equal(ended["contact.force"].values, whole["contact.force"].values)
    ran.clear()
    touches().run(out=tmp_path / "t.zarr", quiet=True)
    assert not ran


@pytest.mark.parametrize("changed", [{"every": 1}, {"keep": ["contact.force"]}, {"over": {"tissue.stiffness": 200.0}},
                                     {"duration": 0.06}, {"finger": {"finger_damping": 9.0}}])  # fmt: skip
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


def test_words_are_stored_as_words(tmp_path):
    asked = touches(keep=["controller.state"])
    whole, stored = asked.run(quiet=True), asked.run(out=tmp_path / "t.zarr", quiet=True)
    assert set(stored["controller.state"].values.ravel()) <= {"free", "contact"}
    assert stored["controller.state"].values.tolist() == whole["controller.state"].values.tolist()


MEASURED = """
import sys, numpy as np, palpate
from palpate.launch.run.lane_blocks import LaneBlocks, LaneKeep

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

used = {}
for lanes in (20, 20, 1020):  # the first run also loads kernels and meshes
    over = {"scene.finger.finger_damping": np.linspace(6.0, 10.0, lanes)}
    asked = palpate.Ensemble("kidney", lanes, over, duration=0.01, sets=["scene.hand.begin=[0, 0, 0.1085]"],
                             tissue=f"deformation.{sys.argv[1]}")
    blocks = LaneBlocks(asked._lane, asked._lane.first, lanes, lanes, LaneKeep([("contact", "force")], 10, 5))
    for block in blocks.run([0], 1, lambda ran: None):
        used[lanes], stated = resident(), block.memory[0] / lanes
print((used[1020] - used[20]) / 1000, stated)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(("body", "most"), [("MassSpring", 40e3), ("ReducedFE", 120e3)])
def test_the_memory_that_is_stated_is_the_memory_that_is_used(body, most):
    """In a separate process, whose memory no other test has used before."""
    done = subprocess.run([sys.executable, "-c", MEASURED, body], capture_output=True, text=True, check=True)
    used, stated = map(float, done.stdout.split())
    assert stated < most and 0.7 * stated < used < 1.5 * stated + 15e3
