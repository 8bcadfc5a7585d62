"""`palpate picture --at` and `--film`: the surface at one instant and through a recording."""

import importlib.util
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from drawing import needs_drawing
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.messages import Pose
from palpate.nodes.base import Stream
from palpate.nodes.logger import Mcap
from palpate.records.reader import Recording
from palpate.views.errors import PictureError
from palpate.views.surface import film as films
from palpate.views.surface.colour import COLOURS


@pytest.fixture
def file(short_kidney):
    return short_kidney


def error_of(*arguments):
    """The error message of a failing command, on one line."""
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code != 0
    assert "Traceback" not in result.output
    return unwrapped(result.stderr)


def test_a_picture_shows_the_requested_instant(file, tmp_path):
    needs_drawing()
    target = tmp_path / "new" / "deep.png"
    assert films.picture(file, 0.3, target) == pytest.approx(0.3)
    assert target.read_bytes()[:4] == b"\x89PNG"


def test_a_film_has_the_right_number_of_frames_and_shows_motion(file, tmp_path):
    needs_drawing()
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed (extra film)")
    target = tmp_path / "kidney.mp4"
    count = films.film(file, target, rate=10.0)
    reader = ffmpeg.read_frames(str(target))
    about = next(reader)
    width, height = about["size"]
    frames = [np.frombuffer(frame, np.uint8).reshape(height, width, 3).astype(int) for frame in reader]
    assert count == len(frames) == 4  # at 0, 0.1, 0.2, 0.3 s of 0.349 s
    assert about["fps"] == 10.0
    middle = slice(height // 6, None), slice(None, 3 * width // 4)  # no title, no colour bar
    assert np.abs(frames[-1][middle] - frames[0][middle]).max() > 60


@pytest.mark.parametrize("stop", [KeyboardInterrupt, None])
def test_ctrl_c_during_a_film_stays_an_interrupt_though_it_ends_ffmpeg(stop, tmp_path):
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed (extra film)")
    figure = pytest.importorskip("matplotlib.figure").Figure(figsize=(0.64, 0.48))

    def encoders():
        for children in Path(f"/proc/{os.getpid()}/task").glob("*/children"):
            for child in map(int, children.read_text().split()):
                if "ffmpeg" in Path(f"/proc/{child}/comm").read_text():
                    yield child

    def frames():
        yield figure
        while not (found := list(encoders())):
            pass  # the process is still a copy of this one
        for child in found:
            os.kill(child, signal.SIGKILL)
        if stop is not None:
            raise stop

    with pytest.raises(stop or PictureError, match="ffmpeg" if stop is None else None):
        films._write(tmp_path / "film.mp4", frames(), 10.0, lambda count: None)


def test_a_gif_is_written_frame_by_frame(tmp_path):
    image = pytest.importorskip("PIL.Image", reason="pillow is not installed (extra film)")
    figure = pytest.importorskip("matplotlib.figure").Figure(figsize=(0.3, 0.2))

    def frames():
        for shade in ("black", "grey", "white"):
            figure.set_facecolor(shade)
            yield figure

    counted = []
    films._write(tmp_path / "grey.gif", frames(), 10.0, counted.append)
    assert counted == [1, 2, 3]
    with image.open(tmp_path / "grey.gif") as made:
        assert made.n_frames == 3
        assert made.size == (30, 20)
        assert made.info["duration"] == 100


def test_all_frames_share_the_arrow_scale_and_the_camera(file, monkeypatch):
    """Batches are drawn separately; each gets the fingers and the largest force of all instants."""
    scenes = []

    class Noted:
        def __init__(self, mesh, batch, values, near, most, all_of):
            assert len(values) == len(batch)
            scenes.append((len(batch), most, len(all_of)))
            self.batch = batch

        def pixels(self):
            return {"wide": np.zeros((len(self.batch), 52, 90, 3), np.uint8)}

        def close(self):
            pass

    monkeypatch.setattr(films, "Rendering", Noted)
    monkeypatch.setattr(films, "BATCH", 2)
    touch = films.TouchStreams(Recording(file))
    shown = films.bodies_of(touch)
    instants = films.instants_at(touch, shown, [100, 200, 300])
    titles = [one.axes[0].get_title(loc="left") for one in films._frames(shown.mesh, instants, COLOURS["displacement"])]
    assert [(count, total) for count, _, total in scenes] == [(2, 3), (1, 3)]
    assert len({most for _, most, _ in scenes}) == 1
    assert titles[0].startswith("0.10 s") and titles[2].startswith("0.30 s")


def test_invalid_requests_are_errors_of_one_line(file, tmp_path, monkeypatch):
    assert "recorded from 0.000 s to 0.349 s" in error_of("picture", file, "--at", "2 s")
    assert "--at" in error_of("picture", file, "--at", "2 N")
    refused = error_of("picture", file, "--film", "-o", tmp_path / "x.avi")
    assert "expected .mp4 or .gif" in refused and "drawing" not in refused
    assert "drawing" not in error_of("picture", tmp_path / "nowhere.mcap", "--film", "-o", tmp_path / "x.mp4")
    assert "expected a folder" in error_of("picture", file, "-o", tmp_path / "x.png")
    there = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda n, *more: None if n == "imageio_ffmpeg" else there(n, *more)
    )
    assert 'pip install "palpate[film]"' in error_of("picture", file, "--film", "-o", tmp_path / "x.mp4")
    assert not list(tmp_path.iterdir())


def test_a_recording_without_a_shape_or_messages_is_an_error(tmp_path):
    empty = tmp_path / "empty.mcap"
    log = Mcap(path=str(empty))
    log.listen((Stream("finger", Pose, "finger", 1),), {"plan": {"nodes": []}})
    log.start()
    log.stop()
    assert "no stream of surfaces" in error_of("picture", empty, "--at", "0")
    assert "no message was recorded" in error_of("picture", empty, "finger.position")
