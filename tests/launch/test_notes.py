"""What the shell prints about a run, Python returns."""

import json
import pickle
import tracemalloc
import warnings

import numpy as np
import pytest
from expected_notes import COARSE, UNTAKEN
from short_touch import QUICK
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.launch.run.notes import LaneNotes, RunNote, first_of_each_kind, lines

GIVEN = {"duration": 0.1, "sets": QUICK, "tissue": "deformation.Rigid"}


def test_notes_of_one_kind_differ_in_numbers_only():
    notes = [RunNote("3.2 mm at 0.1 s", "contact", 0.1), RunNote("4 mm at 1e-3 s", "contact"), RunNote("3.2 mm", "a")]
    assert list(first_of_each_kind(notes).items()) == [(notes[0], 2), (notes[2], 1)]
    again = pickle.loads(pickle.dumps(notes[0]))
    assert (again.node, again.time, again.text, again.lane) == ("contact", 0.1, "3.2 mm at 0.1 s", None)


def test_a_run_has_the_notes_that_the_shell_prints(tmp_path):
    words = [f"--set={text}" for text in QUICK]
    shell = CliRunner().invoke(
        app, ["run", "kidney", "--fused", "--duration", "0.1", "--json", "--no-pictures", "--record",
              str(tmp_path / "a.mcap"), "--set", "tissue.use=deformation.Rigid", *words],
    )  # fmt: skip
    with pytest.warns(palpate.PalpateWarning) as warned:
        run = palpate.run("kidney", record=tmp_path / "b.mcap", **GIVEN)
    printed = json.loads(shell.stdout)["notes"]
    assert printed and [note.text for note in run.notes] == printed
    assert all(isinstance(note.node, str) and 0.0 <= note.time <= 0.1 for note in run.notes)
    assert "controller" in {note.node for note in run.notes}
    assert len(warned) == len(first_of_each_kind(run.notes))
    assert palpate.open(run.path).notes == run.notes


@pytest.mark.notes(UNTAKEN, COARSE)
def test_an_ensemble_has_the_notes_of_its_lanes():
    ensemble = palpate.Ensemble("kidney", 2, {"controller.limit": [3.0, 4.0]}, **GIVEN)
    with pytest.warns(palpate.PalpateWarning, match="lane 0 and 1 more, controller: Haptic: the contact is stiffer"):
        found = ensemble.run(quiet=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", palpate.PalpateWarning)
        run = palpate.run("kidney", record=False, **GIVEN)
    for lane in range(2):
        of_lane = {note.text for note in ensemble.notes if note.lane == lane}
        assert of_lane == {note.text for note in run.notes}
    xarray = pytest.importorskip("xarray")
    assert isinstance(found, xarray.Dataset) and found["controller.limit"].attrs["units"] == "N"


def test_notes_of_many_lanes_are_listed_by_lane_in_little_memory():
    notes, texts = LaneNotes(0.2), {"tissue": "a long line " * 20, "contact": "another line"}
    tracemalloc.start()
    for lane in reversed(range(20_000)):
        for node, text in texts.items():
            notes.add(lane, node, "".join(text))  # each block brings separate copies
    assert tracemalloc.get_traced_memory()[0] < 20 * len(notes)
    tracemalloc.stop()
    assert len(notes) == 40_000 and notes == list(notes) and notes != LaneNotes()
    assert [(n.lane, n.node) for n in notes[:3]] == [(0, "tissue"), (0, "contact"), (1, "tissue")]
    assert notes[-1] == texts["contact"] and notes[-1].lane == 19_999
    assert [line[:24] for line in lines(notes)] == ["lane 0 and 19999 more, t", "lane 0 and 19999 more, c"]


@pytest.mark.notes(UNTAKEN, COARSE)
def test_a_study_has_the_notes_of_its_points(tmp_path):
    """Also of points whose results were stored before; points run as lanes, or as runs with a recording."""
    pytest.importorskip("pyarrow")
    sets = [*QUICK, "tissue.use=deformation.Rigid"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", palpate.PalpateWarning)
        run = palpate.run("kidney", record=False, **GIVEN)
    for keep in (["peak contact.force"], ["peak contact.force", "recording"]):
        study = palpate.Study("kidney", {"controller.limit": [3.0, 4.0]}, keep, duration=0.1, sets=sets)
        folder = tmp_path / str(len(keep))
        for _ in range(2):
            with pytest.warns(palpate.PalpateWarning, match="point 0 and 1 more, controller: Haptic: the contact is"):
                study.run(folder, workers=1)
            for point in range(2):
                of_point = {(note.node, note.text) for note in study.notes if note.lane == point}
                assert of_point == {(note.node, note.text) for note in first_of_each_kind(run.notes)}
    assert all(0.0 <= note.time <= 0.1 for note in study.notes)


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")
def test_a_run_without_a_file_leaves_none_and_has_its_messages(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runs = [palpate.run("kidney", record=no, **GIVEN) for no in (False, None)]
    assert not list(tmp_path.iterdir())
    assert len(runs[0].contact) == 100 and np.array_equal(runs[0].contact.force, runs[1].contact.force)
    pytest.importorskip("xarray")
    table = runs[0].xarray(["contact", "finger"])
    assert table["contact.force"].attrs["units"] == "N" and table.time.attrs["units"] == "s"
    assert np.array_equal(table["contact.force"], runs[0].contact.force)
    assert table["finger.position"].dims == ("time", "axis") and np.array_equal(table.time, runs[0].finger.time)


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")
def test_settings_are_a_list_or_a_mapping():
    force = [
        palpate.run("kidney", record=False, duration=0.01, sets=sets).contact.force
        for sets in (
            [*QUICK, "controller.limit=2 N"],
            {**dict(s.split("=", 1) for s in QUICK), "controller.limit": 2.0},
        )
    ]
    assert np.array_equal(*force)
