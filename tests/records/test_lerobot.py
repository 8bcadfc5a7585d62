"""Data sets in the format of LeRobot: the rules of its version 3.0, values and statistics by an independent route."""

import errno
import io
import json
import sys
import warnings

import numpy as np
import pytest
from shell_text import unwrapped
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.launch.run import lane_blocks
from palpate.physics.errors import ArgumentError, RunError
from palpate.records.export import export
from palpate.records.lerobot.features import Feature
from palpate.records.lerobot.frames import Frames
from palpate.records.lerobot.writer import LeRobotSet
from palpate.records.reader import Recording
from palpate.records.side_view import FINGER, FORCE, TISSUE
from palpate.records.stored import RecordingError

pq = pytest.importorskip("pyarrow.parquet")

pytestmark = pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")  # notes about a fast first contact
DURATION = 0.3
BEGIN, TO = [0.0, 0.0, 0.1088], [0.004, 0.0, 0.1065]
SETS = (f"scene.hand.begin={BEGIN}", f"scene.hand.path=[{{to: {TO}, time: 0.25}}]")
STANDARD = {"timestamp": "float"} | dict.fromkeys(["frame_index", "episode_index", "index", "task_index"], "int64")


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Recording:
    path = tmp_path_factory.mktemp("touch") / "kidney.mcap"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", palpate.PalpateWarning)
        palpate.run("kidney", duration=DURATION, sets=SETS, record=path)
    return Recording(path)


def read(folder):
    """The info, and all rows of frames and of episodes, after a check of the format's rules."""
    info = json.loads((folder / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0" and isinstance(info["fps"], int)
    rows = [row for file in sorted(folder.glob("data/*/*.parquet")) for row in pq.read_table(file).to_pylist()]
    parts = [pq.read_table(file) for file in sorted(folder.glob("meta/episodes/*/*.parquet"))]
    episodes = [row for part in parts for row in part.to_pylist()]
    assert (info["total_frames"], info["total_episodes"]) == (len(rows), len(episodes))
    tasks = pq.read_table(folder / "meta" / "tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    assert set(rows[0]) == set(info["features"]) and set(STANDARD) < set(rows[0])
    kinds = {f.name: str(f.type) for f in pq.read_schema(next(folder.glob("data/*/*.parquet")))}
    assert {name: kinds[name] for name in STANDARD} == STANDARD
    for name, feature in info["features"].items():
        assert "/" not in name and (name in STANDARD or feature["dtype"] == "float32")
        for row in rows:
            assert list(np.shape(row[name])) == ([] if feature["shape"] == [1] else feature["shape"])
        if name not in STANDARD:
            assert len(feature["names"]) == len(feature["units"]) == feature["shape"][-1]
    assert [row["index"] for row in rows] == list(range(len(rows)))
    end = 0
    for number, episode in enumerate(episodes):
        assert episode["episode_index"] == number and episode["dataset_from_index"] == end
        end = episode["dataset_to_index"]
        part = rows[episode["dataset_from_index"] : end]
        assert len(part) == episode["length"] and {row["episode_index"] for row in part} == {number}
        assert [row["frame_index"] for row in part] == list(range(len(part)))
        assert np.allclose([row["timestamp"] for row in part], np.arange(len(part)) / info["fps"], atol=1e-4)
        place = {"chunk_index": episode["data/chunk_index"], "file_index": episode["data/file_index"]}
        kept = pq.read_table(folder / info["data_path"].format(**place), columns=["index"])["index"].to_pylist()
        assert set(range(episode["dataset_from_index"], end)) <= set(kept)
        assert episode["tasks"] == tasks["task"].to_pylist()
    assert end == len(rows)
    return info, rows, episodes


def check_statistics(folder, rows, episodes):
    """All statistics, recomputed from the rows; a window's samples are pooled."""
    whole = json.loads((folder / "meta" / "stats.json").read_text())
    assert set(whole) == set(rows[0])

    def check(found, part, name):
        values = np.array([row[name] for row in part], float)
        flat = values.reshape(-1, values.shape[-1]) if values.ndim > 1 else values[:, None]
        expected = {"min": flat.min(0), "max": flat.max(0), "mean": flat.mean(0), "std": flat.std(0)}
        expected["count"] = [len(part)]
        for key, share in {"q01": 1, "q10": 10, "q50": 50, "q90": 90, "q99": 99}.items():
            expected[key] = np.percentile(flat, share, axis=0)
        assert set(found) == set(expected)
        for key, value in expected.items():
            assert np.allclose(found[key], value, rtol=1e-6, atol=1e-12), (name, key)

    for name in rows[0]:
        check(whole[name], rows, name)
        for episode in episodes:
            head = f"stats/{name}/"
            found = {key.removeprefix(head): value for key, value in episode.items() if key.startswith(head)}
            check(found, rows[episode["dataset_from_index"] : episode["dataset_to_index"]], name)


def test_a_recording_becomes_an_episode_with_the_newest_messages_of_each_sample(recording, tmp_path):
    export(recording, "lerobot", tmp_path / "set", touch_rate=170.0)
    info, rows, episodes = read(tmp_path / "set")
    check_statistics(tmp_path / "set", rows, episodes)
    window = 6  # 170 samples per second, 30 frames
    begin = (window - 1) / 170.0
    assert len(rows) == int((0.299 - begin) * 30) + 1 and info["fps"] == 30
    ticks = {name: list(recording.messages(name)) for name in ("finger", "contact", "friction")}
    pressed = 0
    for j, row in enumerate(rows):
        time = begin + j / 30.0
        here = ticks["finger"][int(time * 1000.0 + 1e-6)]
        assert np.allclose(row["observation.state"], [*here.position, *here.velocity], atol=1e-6)
        s = min(time / 0.25, 1.0)
        share = s**3 * (10 - 15 * s + 6 * s * s)
        assert np.allclose(row["action"], np.add(BEGIN, share * np.subtract(TO, BEGIN)), atol=1e-7)
        for i, sample in enumerate(row["observation.touch.contact"]):
            at = int((time - (window - 1 - i) / 170.0) * 1000.0 + 1e-6)
            touch, rub = ticks["contact"][at], ticks["friction"][at]
            force = touch.force * np.array(touch.normal) - rub.force + touch.lateral_force
            expected = [*touch.foot, *(-touch.indentation * np.array(touch.normal)), *force]
            assert np.allclose(sample, expected, rtol=1e-6, atol=1e-9)
            pressed += touch.force > 0.1 and np.linalg.norm(rub.force) > 0.01
    assert pressed > 10


def test_lerobot_can_add_episodes_as_to_its_sets(recording, tmp_path):
    """It begins a file when the next episode would exceed the size that the set names [MB], and a folder after
    `chunks_size` files: with the defaults of its format v3.0, not a file for each episode."""
    export(recording, "lerobot", tmp_path / "set")
    info = read(tmp_path / "set")[0]
    assert info["codebase_version"] == "v3.0" and info["chunks_size"] == 1000
    assert info["data_files_size_in_mb"] == 100 and info["video_files_size_in_mb"] == 200
    assert info["data_path"].format(chunk_index=0, file_index=0) == "data/chunk-000/file-000.parquet"


def touches(over, count, **given):
    given = {"duration": DURATION, "sets": SETS} | given
    return palpate.Ensemble("kidney", count, over, **given)


def test_lanes_become_the_episodes_of_single_runs(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(lane_blocks, "LANES", 2)
    paths = [[{"to": [0.001 * n, 0.0, 0.1065], "time": 0.2}] for n in range(5)]
    paths[3] = [{"to": TO, "time": 0.25}]
    over = {"tissue.stiffness": [150.0, 200.0, 250.0, 257.0, 300.0], "scene.hand.path": paths}
    out = touches(over, 5).run(out=tmp_path / "set", form="lerobot", quiet=True)
    _, rows, episodes = read(out)
    check_statistics(out, rows, episodes)
    assert [e["settings/lane"] for e in episodes] == [0, 1, 2, 3, 4] and len(list(out.glob("data/*/*"))) == 3
    assert [e["settings/tissue.stiffness"] for e in episodes] == over["tissue.stiffness"]
    assert "0.002" in episodes[2]["settings/scene.hand.path"]
    export(recording, "lerobot", tmp_path / "one")  # of the settings of lane 3
    _, single, _ = read(tmp_path / "one")
    third = rows[episodes[3]["dataset_from_index"] : episodes[3]["dataset_to_index"]]
    for name in ("observation.state", "observation.touch.contact", "action"):
        assert [row[name] for row in third] == [row[name] for row in single]
    assert rows[0]["action"] != third[0]["action"]


def test_without_friction_the_force_of_a_touch_is_that_of_the_contact(tmp_path):
    path = tmp_path / "smooth.mcap"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        palpate.run("kidney", duration=DURATION, sets=(*SETS, "scene.tissue.friction=false"), record=path)
    export(Recording(path), "lerobot", tmp_path / "set")
    _, rows, _ = read(tmp_path / "set")
    touched = [np.array(row["observation.touch.contact"]) for row in rows]
    force = Recording(path).columns("contact")["force"]
    assert max(np.linalg.norm(each[..., 6:9], axis=-1).max() for each in touched) == pytest.approx(
        force.max(), rel=0.05
    )


def test_a_lane_that_fails_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(lane_blocks, "LANES", 2)  # the first block is checked before anything runs
    with pytest.warns(RuntimeWarning, match="1 of 4 lanes failed"):
        out = touches({"device.mass": [0.2, 0.3, -1.0, 0.4]}, 4).run(out=tmp_path / "set", form="lerobot", quiet=True)
    _, _, episodes = read(out)
    assert [e["settings/lane"] for e in episodes] == [0, 1, 3]


def test_quantiles_of_long_sets_are_those_of_evenly_spaced_frames(tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.records.lerobot.statistics.FRAMES", 500)
    draw = np.random.default_rng(1)
    feature = {"action": Feature((2,), ("a", "b"), ("1", "1"))}
    made = LeRobotSet(tmp_path / "set", 30, feature, "draw", {}, 5000)
    values = draw.normal(size=(5, 10, 100, 2)).astype(np.float32)
    for block in values:
        made.add({"action": block})
    found = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())["action"]
    flat = values.reshape(-1, 2).astype(float)
    assert np.allclose(found["q50"], np.median(flat[::10], axis=0)) and found["count"] == [5000]
    assert np.allclose(found["mean"], flat.mean(axis=0)) and np.allclose(found["std"], flat.std(axis=0))


def test_a_full_disk_keeps_the_complete_episodes(tmp_path, monkeypatch):
    monkeypatch.setattr(lane_blocks, "LANES", 2)
    write, written = pq.write_table, []

    def full(table, path, **given):
        if len(written) == 4:  # the second block's table of episodes
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(path)
        write(table, path, **given)

    monkeypatch.setattr(pq, "write_table", full)
    folder = tmp_path / "set"
    with pytest.raises(RunError, match="No space left on device; its 2 complete episodes stay readable") as error:
        touches({"tissue.stiffness": [200.0] * 4}, 4).run(out=folder, form="lerobot", quiet=True)
    assert "\n" not in str(error.value) and len(read(folder)[2]) == 2
    assert not (folder / ".writing").exists()


def test_a_full_disk_leaves_no_half_of_an_export(recording, tmp_path, monkeypatch):
    def full(table, path, **given):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pq, "write_table", full)
    with pytest.raises(RunError, match="No space left on device; nothing is kept"):
        export(recording, "lerobot", tmp_path / "set")
    assert not (tmp_path / "set").exists()


def test_bad_input_of_an_export_is_one_line(recording, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    for options, words in (
        (["-o", str(tmp_path / "full")], "found mine.txt in"),
        (["-o", str(tmp_path / "file")], "expected an empty or missing folder"),
        (["--fps", "0"], "greater than or equal to 1"),
        (["--touch-rate", "20"], "expected a number from fps=30"),
        (["--touch-rate", "2000"], "has 1000 messages per second, expected at least 2000"),
        (["--stream", "finger"], "needs a stream of touch"),
        (["--every", "2"], "needs every message"),
        (["--fps", "2", "--touch-rate", "20"], "expected at least 0.45 s"),
    ):
        done = CliRunner().invoke(app, ["export", str(recording.path), "--to", "lerobot", *options])
        assert done.exit_code == 2 and words in unwrapped(done.output), done.output
        assert "Traceback" not in done.output
    done = CliRunner().invoke(app, ["export", str(recording.path), "--to", "csv", "--fps", "30"])
    assert done.exit_code == 2 and "expected --to lerobot" in done.output
    assert (tmp_path / "full" / "mine.txt").read_text() == (tmp_path / "file").read_text() == "mine"
    assert len(list(tmp_path.rglob("*"))) == 3


@pytest.mark.parametrize("lost", ["friction", "finger"])
def test_a_stream_that_was_not_recorded_is_an_error(lost, tmp_path):
    path = tmp_path / "touch.mcap"
    palpate.run("kidney", duration=0.02, record=path, sets=[f"log.leave_out=[{lost}]"])
    with pytest.raises(RecordingError, match=f"needs stream '{lost}', which was not recorded"):
        export(Recording(path), "lerobot", tmp_path / "set")


def test_bad_input_of_an_ensemble_is_an_error_before_it_runs(tmp_path):
    asked = touches({}, 2)
    (tmp_path / "mine.txt").write_text("mine")
    for given, words in (
        ({"form": "rlds"}, "expected one of zarr, lerobot"),
        ({}, "found no `out`"),
        ({"out": tmp_path}, "found mine.txt in"),
        ({"out": tmp_path / "a", "fps": 29.97}, "expected a whole number"),
        ({"out": tmp_path / "a", "touch_rate": 1001.0}, "expected at most 1000"),
    ):
        with pytest.raises(ArgumentError, match=words):
            asked.run(**{"form": "lerobot", "quiet": True} | given)
    assert not (tmp_path / "a").exists()


def test_without_pyarrow_one_line_names_the_extra(recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ArgumentError, match=r'pip install "palpate\[export\]"'):
        export(recording, "lerobot", tmp_path / "set")


def test_a_window_has_no_gap_between_frames():
    for rate, touch in ((30, 150.0), (30, 1000.0), (24, 100.0), (30, 30.0)):
        frames = Frames(rate, touch)
        times = frames.times(0.0, 3.0)
        samples = frames.samples(times)
        assert np.all(samples[1:, 0] - samples[:-1, -1] <= 1.0 / touch + 1e-9) and samples[0, 0] == pytest.approx(0.0)
        assert np.allclose(np.diff(samples, axis=1), 1.0 / touch) and np.all(samples[:, -1] == times)
        assert 3.0 - times[-1] < 1.0 / rate


def test_pictures_show_finger_force_and_tissue_of_each_frame(recording, tmp_path):
    from PIL import Image

    export(recording, "lerobot", tmp_path / "set", camera=True)
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    feature = info["features"]["observation.images.side"]
    assert feature["dtype"] == "image" and feature["shape"] == [240, 320, 3]
    assert feature["names"] == ["height", "width", "channels"]
    rows = pq.read_table(next((tmp_path / "set").glob("data/*/*.parquet"))).to_pylist()
    scale, pressed, thinned = 320 / 0.08, 0, []
    for row in rows:
        picture = np.array(Image.open(io.BytesIO(row["observation.images.side"]["bytes"])))
        assert picture.shape == (240, 320, 3) and row["observation.images.side"]["path"] is None
        thinned.append(picture[::4, ::4] / 255.0)
        y, x = np.nonzero((picture == FINGER).all(axis=-1))
        away = np.array(row["observation.state"][:3]) - BEGIN
        assert x.min() + x.max() + 1 == pytest.approx(320 + 2 * scale * away[0], abs=3)
        assert y.max() == pytest.approx(scale * (0.01 - away[2]), abs=2)  # the lowest point
        bar = (picture == FORCE).all(axis=-1).any(axis=1).sum()
        force = np.linalg.norm(row["observation.touch.contact"][-1][6:])
        assert bar == pytest.approx(scale * 6e-3 * force, abs=2)
        pressed += bar > 4
    assert pressed > 2
    sinks = [np.argmax((np.rint(255 * each) == TISSUE).all(axis=-1)[:, 40:44].any(axis=1)) for each in thinned]
    assert sinks[-1] > sinks[0]  # the tissue below the finger yields
    for found in (
        json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())["observation.images.side"],
        {name: pq.read_table(next((tmp_path / "set").glob("meta/episodes/*/*.parquet")))[
            f"stats/observation.images.side/{name}"].to_pylist()[0] for name in ("mean", "std", "count", "q90")},
    ):  # fmt: skip
        flat = np.reshape(thinned, (-1, 3))
        assert np.shape(found["mean"]) == (3, 1, 1) and found["count"] == [len(rows)]
        for name, value in {"mean": flat.mean(0), "std": flat.std(0), "q90": np.quantile(flat, 0.9, axis=0)}.items():
            np.testing.assert_allclose(np.ravel(found[name]), value, rtol=1e-5)


def test_pictures_need_frames(recording, tmp_path):
    with pytest.raises(RecordingError, match="--camera: found --to csv, expected --to lerobot"):
        export(recording, "csv", tmp_path / "set", camera=True)
