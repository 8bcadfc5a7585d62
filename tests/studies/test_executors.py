"""Studies and ensembles on executors: any of them gives the same bytes, and loses nothing that was finished."""

import json
import warnings
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait

import numpy as np
import pytest
from expected_notes import STIFF

import palpate
from palpate.launch.run import lane_blocks
from palpate.launch.run.tasks import spread
from palpate.physics.errors import RunError
from palpate.studies.sweeps.store import Store

BALL = """
nodes:
  ball: {use: nodes_for_studies.Ball}
wanted: [ball]
run: {duration: 5 ms}
"""
KEEP = ("peak ball.force", "curve ball.force")
TOUCH = {"duration": 0.02, "sets": ("scene.hand.begin=[0, 0, 0.1085]",)}


@pytest.fixture
def study(write):
    graph = write("ball.yaml", BALL)
    return lambda **over: palpate.Study(graph, {"ball.young": list(np.linspace(1e4, 2e4, 12)), **over}, KEEP)


@pytest.fixture
def large_blocks(monkeypatch):
    """A block of one point, then blocks of half of the remaining points."""
    monkeypatch.setattr(spread, "FIRST", 1)
    monkeypatch.setattr(spread, "AHEAD", 1)
    monkeypatch.setattr(spread, "BLOCK", 1e6)


def stored(folder):
    """The results in the folder of a study."""
    files = [folder / "points.parquet", *sorted((folder / "curves.zarr").rglob("*"))]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files if file.is_file()}


def ensemble(lanes=7, **given):
    stiffness = np.linspace(150.0, 350.0, lanes)
    return palpate.Ensemble("kidney", lanes, {"tissue.stiffness": stiffness}, ["contact.force"], **TOUCH | given)


class Losing:
    """An executor that computes some blocks and loses the others, as one whose machine is switched off."""

    def __init__(self, executor, computed):
        self.executor, self.left = executor, computed

    def submit(self, fn, /, *given):
        self.left -= 1
        if self.left >= 0:
            future = self.executor.submit(fn, *given)
            wait([future])
            return future
        lost = Future()
        lost.set_exception(ConnectionError("no route to host"))
        return lost


@pytest.mark.parametrize("kind", [ProcessPoolExecutor, ThreadPoolExecutor])
def test_a_study_has_the_same_bytes_on_any_executor(study, pool, tmp_path, kind):
    study().run(tmp_path / "here", pool)
    with kind(2) as executor:
        study().run(tmp_path / "there", executor)
    assert stored(tmp_path / "there") == stored(tmp_path / "here") and len(study()) == 12


@pytest.mark.notes(STIFF)
def test_an_ensemble_has_the_same_results_on_an_executor(pool, tmp_path, monkeypatch):
    monkeypatch.setattr(lane_blocks, "LANES", 2)
    asked = ensemble()
    here, notes = asked.run(quiet=True), asked.notes
    there = asked.run(quiet=True, executor=pool)
    assert there.identical(here) and asked.notes == notes and asked.memory[0] > 0
    assert asked.run(quiet=True, executor=pool, out=tmp_path / "t.zarr").load().equals(here)


@pytest.mark.notes(STIFF)
def test_a_store_of_lanes_is_continued_where_blocks_are_missing(pool, tmp_path, monkeypatch):
    """Blocks end in any order on an executor."""
    monkeypatch.setattr(lane_blocks, "LANES", 2)
    here, lanes = ensemble().run(quiet=True), []
    with pytest.raises(RunError, match=r"lost a block \(ConnectionError: no route to host\); what was computed"):
        ensemble().run(quiet=True, out=tmp_path / "t.zarr", executor=Losing(pool, 2))
    block = lane_blocks.LaneBlocks.block
    monkeypatch.setattr(
        lane_blocks.LaneBlocks, "block", lambda s, first, *g: lanes.append(first) or block(s, first, *g)
    )
    data = ensemble().run(quiet=True, out=tmp_path / "t.zarr")
    assert lanes == [4, 6] and np.array_equal(data["contact.force"], here["contact.force"])


def test_a_lane_that_is_refused_on_an_executor_is_named(pool, monkeypatch):
    monkeypatch.setattr(lane_blocks, "LANES", 2)
    asked = palpate.Ensemble("kidney", 5, {"tissue.stiffness": [200.0, 210.0, 220.0, -1.0, 230.0]}, **TOUCH)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        data = asked.run(quiet=True, executor=pool)
    assert ["stiffness" in text for text in data["error"].values] == [False, False, False, True, False]
    assert any("lane 3 (tissue.stiffness=-1.0)" in str(each.message) for each in caught)


def test_in_a_block_only_the_points_that_crash_have_no_result(study, pool, tmp_path, large_blocks):
    bad = {"ball.young": [1e4, 2e4, 3e4], "ball.what": ["", "fail", "kill"]}
    table = study(**bad).run(tmp_path / "out", pool).table()
    expected = {"": "", "kill": "its process ended: SIGKILL", "fail": "ValueError: the mesh is inside out"}
    assert all(error.endswith(expected[what]) for what, error in zip(table["ball.what"], table["error"], strict=True))
    assert (table["error"] == "").sum() == table["peak ball.force"].notna().sum() == 3


def test_blocks_take_a_few_seconds(study, pool, tmp_path, monkeypatch):
    monkeypatch.setattr(spread, "FIRST", 1)
    monkeypatch.setattr(spread, "BLOCK", 2.0)  # [s], so that also a busy machine computes two in it
    counts, work = [], spread.work
    monkeypatch.setattr(spread, "work", lambda *given: counts.append(len(given[2])) or work(*given))
    study(**{"ball.pause": [0.1, 0.101]}).run(tmp_path / "out", pool)
    assert sum(counts) == 24 and counts[0] == 1 and max(counts) in range(2, 21)


def test_a_lost_block_loses_nothing_that_was_finished(study, pool, tmp_path):
    """The same study computes what is missing, and its bytes are those of a study that lost nothing."""
    study().run(tmp_path / "whole", pool)
    with pytest.raises(RunError, match=r"lost a block \(ConnectionError: no route to host\); what was computed"):
        study().run(tmp_path / "out", Losing(pool, 5))
    again = []
    assert len(Store(tmp_path / "out", write=False).rows) == 5
    study().run(tmp_path / "out", pool, done=lambda point, done, left: again.append(point.slot))
    assert len(again) == 7 and stored(tmp_path / "out") == stored(tmp_path / "whole")


def test_a_worker_with_other_files_computes_nothing(study, pool, tmp_path):
    """The graph is edited between the start of the study and the computation."""
    asked = study()
    (tmp_path / "ball.yaml").write_text(BALL.replace("Ball}", "Ball, with: {radius: 5 mm}}"), encoding="utf-8")
    with pytest.raises(RunError, match="a file that it names has other contents here"):
        asked.run(tmp_path / "out", pool)
    (tmp_path / "ball.yaml").unlink()
    with pytest.raises(RunError, match=r"the graph does not load here: .*ball\.yaml"):
        asked.run(tmp_path / "out", pool)


def test_a_killed_program_loses_no_finished_block(study, pool, tmp_path, monkeypatch):
    """Rows are on the disk before the table is written; the last line of the file may be torn."""
    monkeypatch.setattr("palpate.studies.sweeps.store.AT_LEAST", 1e9)  # a slow machine writes no table in between
    study().run(tmp_path / "whole", pool)
    done, asked = Store(tmp_path / "whole", write=False), study()
    store, task = Store(tmp_path / "out"), asked._task()
    store.describe(asked.base, asked._about, {})
    results = dict(task.compute(asked.points[:5]))
    store.add(asked.base, [(point, results[place]) for place, point in enumerate(asked.points[:5])])
    store.close()  # as at a kill: nothing is flushed
    assert not (tmp_path / "out" / "points.parquet").exists()
    with open(tmp_path / "out" / "unwritten.jsonl", "a", encoding="utf-8") as file:
        file.write(json.dumps(done.rows[asked.points[5].key])[:40])
    again = []
    asked.run(tmp_path / "out", pool, done=lambda point, done, left: again.append(point.slot))
    assert sorted(again) == list(range(5, 12)) and stored(tmp_path / "out") == stored(tmp_path / "whole")
    assert not (tmp_path / "out" / "unwritten.jsonl").exists()
