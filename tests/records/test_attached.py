"""The data files of a run in its recording: a replay and a picture where these are missing or have changed."""

import json
import shutil

import numpy as np
import pytest
from mcap.reader import make_reader

from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile
from palpate.launch.run.execute import execute
from palpate.physics.geometry.mesh import write_ply
from palpate.physics.readable import hash_of_file
from palpate.records.changed import change_plan
from palpate.records.contents import contents
from palpate.records.fill import recover
from palpate.records.reader import Recording
from palpate.records.replay import Replay
from palpate.records.verify import verify
from palpate.studies.organs.shapes import star
from palpate.views.pictures.touch import TouchStreams
from palpate.views.surface.moments import bodies_of


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def ball(path, radius=0.02):
    write_ply(path, star(lambda way: np.full(len(way), radius), 2000))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A recording, its organ, and the bytes of both."""
    folder = tmp_path_factory.mktemp("made")
    ball(folder / "organ.ply")
    launch = find("kidney").but(
        organ=OrganFile(folder / "organ.ply", unit="m"), place="fused", record=folder / "run.mcap", duration=0.3
    )
    assert execute(launch).result.ok
    return folder


@pytest.fixture
def run(made, tmp_path):
    """A copy of both; the organ of the settings is that of `made`, which each test leaves as it was."""
    shutil.copy(made / "run.mcap", tmp_path / "run.mcap")
    kept = (made / "organ.ply").read_bytes()
    yield tmp_path / "run.mcap", made / "organ.ply"
    (made / "organ.ply").write_bytes(kept)


def test_a_recording_contains_the_organ_as_an_attachment_that_other_programs_read(run):
    file, organ = run
    with file.open("rb") as opened:
        reader = make_reader(opened, validate_crcs=True)
        (attached,) = reader.iter_attachments()
        (index,) = reader.get_summary().attachment_indexes
    assert attached.name == index.name == str(organ) and index.data_size == len(attached.data)
    recording = Recording(file)
    assert recording.files == {str(organ): hash_of_file(organ)} and not recording.wrong and not recording.moved


@pytest.mark.parametrize("state", ["is missing", "has changed"])
def test_the_copy_takes_the_place_of_an_organ_that_is_missing_or_has_changed(run, state, tmp_path):
    file, organ = run
    before = bodies_of(TouchStreams(Recording(file), whole=True)).mesh.vertices
    organ.unlink()
    if state == "has changed":
        ball(organ, 0.03)
    recording = Recording(file)
    assert recording.wrong == {str(organ): state}
    (entry,) = contents(recording)["files"]
    assert entry["differs"] == state and entry["copy"].startswith(str(tmp_path / "cache"))
    assert verify(recording, change_plan(recording)).verified
    assert np.array_equal(bodies_of(TouchStreams(recording, whole=True)).mesh.vertices, before)
    # a changed replay, and its recording, which has the organ too
    again = tmp_path / "again.mcap"
    Replay(recording, change_plan(recording, ["tissue.stiffness=100"]), out=again).run()
    shutil.rmtree(tmp_path / "cache")
    assert verify(Recording(again), change_plan(Recording(again))).verified
    # a copy of the file
    target, _ = recover(file, tmp_path / "copy.mcap")
    shutil.rmtree(tmp_path / "cache")
    assert len(list(Recording(target).moved)) == 1
    assert np.array_equal(bodies_of(TouchStreams(Recording(target), whole=True)).mesh.vertices, before)


def test_a_cut_recording_has_the_organ_too_and_a_damaged_copy_is_not_used(run, tmp_path):
    file, organ = run
    data = file.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(0.9 * len(data))])
    organ.unlink()
    assert str(organ) in Recording(cut).moved
    at = data.index(b"application/zstd") + 100
    (tmp_path / "bad.mcap").write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
    shutil.rmtree(tmp_path / "cache")
    found = Recording(tmp_path / "bad.mcap")
    assert found.wrong and not found.moved
    # a copy in the cache that has changed is written again
    (kept,) = Recording(file).moved.values()
    before = hash_of_file(kept)
    with open(kept, "ab") as opened:
        opened.write(b" ")
    assert Recording(file).moved == {str(organ): kept} and hash_of_file(kept) == before


def test_a_run_without_files_has_no_attachment(tmp_path):
    launch = find("kidney").but(place="fused", record=tmp_path / "plain.mcap", duration=0.05)
    assert execute(launch).result.ok
    recording = Recording(tmp_path / "plain.mcap")
    assert not recording.files and "files" not in recording.about
    assert b"application/zstd" not in (tmp_path / "plain.mcap").read_bytes()
    json.dumps(contents(recording))
