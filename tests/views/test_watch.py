"""`palpate run --view`: the run while it goes on, in the browser and in a window."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("websockets")

from websockets.sync.client import connect

from palpate.launch.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.views.page.watch import Watch
from palpate.views.page.watching import watchable
from palpate.views.page.window import Window, unpacked

SETS = ("scene.surface.vertices=1000",)
WAIT = 90.0
"""[s] that a busy machine may take."""


@pytest.fixture
def watched(tmp_path):
    """A run of two seconds as processes, nobody recording, and its address."""
    environment = os.environ | {"BROWSER": "true", "XDG_RUNTIME_DIR": str(tmp_path)}
    run = subprocess.Popen(
        [sys.executable, "-m", "palpate.launch", "run", "kidney", "--view", "web", "--no-record", "--duration", "2",
         "--quiet", "--set", SETS[0]],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, cwd=tmp_path,
    )  # fmt: skip
    told = run.stderr.readline()
    yield run, re.search(r"http://(\S+)/\?token=(\S+)", told)
    if run.poll() is None:
        run.send_signal(signal.SIGINT)
        run.wait(WAIT)


def test_the_page_shows_the_run_as_it_goes_stays_at_its_end_and_ends_when_it_is_closed(watched):
    run, address = watched
    host, token = address.groups()
    heads, said, moved = [], [], 0.0
    with connect(f"ws://{host}/socket?token={token}", origin=f"http://{host}", max_size=None) as socket:
        until = time.monotonic() + WAIT
        while time.monotonic() < until and "the run has ended" not in said:
            data = socket.recv(timeout=WAIT)
            if isinstance(data, str):
                said.append(json.loads(data)["text"])
                continue
            head, _, first, _ = unpacked(data)
            heads.append(head)
            if head["kind"] == "frame" and len(first):
                moved = max(moved, float(np.abs(first).max()))
        assert run.poll() is None
    assert heads[0]["kind"] == "mesh" and heads[0]["watch"]
    frames = [head for head in heads if head["kind"] == "frame"]
    assert len(frames) > 5 and [h["time"] for h in frames] == sorted(h["time"] for h in frames)
    assert max(head["load"] for head in frames) > 0.5
    assert moved > 1e-3, "nobody records, and the shape is seen all the same"
    assert said[-2:] == ["running", "the run has ended"]
    assert run.wait(WAIT) == 0, "the only page was closed: nothing is left to show"


class Still(Watch):
    """What a window asks of a run, without one."""

    def start(self) -> None:
        pass


def test_the_window_draws_the_organ_where_it_is(tmp_path):
    pytest.importorskip("pyvista")
    from palpate.messages import Surface
    from palpate.views.page.feed import frame
    from palpate.views.pictures.colour import COLOURS, painted

    source = Still(find("kidney").but(overrides=SETS).plan(), 0, set())
    window = Window(source, off_screen=True)
    assert not window.refresh() or window.organ["value"].max() == 0.0
    surface = Surface(
        nodes=np.array([3, 4], np.int32), displacement=np.array([[0, 0, -6e-3], [0, 0, -3e-3]]), stiffness=1.0,
        exponent=1.0, damping=0.0, free=0.0, previous=0.0, step=1e-3, relaxation=0.0,
    )  # fmt: skip
    head = {"kind": "frame", "time": 0.5, "load": 1.2, "depth": 6e-3, "tip": [0, 0, 0.03], "up": [0, 0, 1],
            "force": [0, 0, 1.2], "stick": True}  # fmt: skip
    source.frame, source.status = frame(head, surface, source.touched.mesh), "running"
    before = np.array(window.organ.points)
    assert window.refresh() and not window.refresh()
    assert np.allclose(np.array(window.organ.points)[3] - before[3], (0, 0, -6e-3), atol=1e-7)
    assert window.organ["value"][4] == pytest.approx(3.0) and np.count_nonzero(window.organ["value"]) == 2
    pixels = window.plotter.screenshot(None, return_img=True)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
    window.another_colour()
    assert list(window.plotter.scalar_bars.keys()) == ["strain of the surface, largest [%]"]
    strain = painted(COLOURS["strain"], source.touched.mesh, surface)
    assert window.organ["value"] == pytest.approx(100 * strain, abs=0.01) and strain.max() > 0.05
    assert window._actor.mapper.scalar_range[1] == pytest.approx(100 * strain.max(), rel=1e-3)
    window.another_colour()
    assert window.colour.name == "displacement" and window.organ["value"][4] == pytest.approx(3.0)
    window.plotter.close()


def test_the_shape_is_computed_where_a_body_can_and_the_pace_is_the_worlds():
    launch = watchable(find("kidney"))
    assert launch.pace == 1.0 and "effects.shape=on" in launch.overrides
    assert watchable(find("kidney").but(pace=0.2)).pace == 0.2
    assert watchable(find("kidney").but(clock="real")).pace is None
    assert "effects.shape=on" not in watchable(find("fingertip-slide")).overrides


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--view"], "no display"),
        (["--view", "web", "--fused"], "leave out --fused"),
        (["--view=paper"], "expected window or web"),
    ],
)
def test_what_cannot_be_seen_is_told_in_a_line(monkeypatch, given, told):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    ran = CliRunner().invoke(app, ["run", "kidney", *given])
    assert ran.exit_code == 2 and told in " ".join(ran.output.split()) and "Traceback" not in ran.output


def test_a_graph_without_a_surface_is_told_before_it_runs(tmp_path, monkeypatch):
    monkeypatch.setenv("BROWSER", "true")
    ran = CliRunner().invoke(app, ["run", "fingertip-slide", "--view", "web", "--no-record"])
    assert ran.exit_code == 2 and "no mesh to show" in " ".join(ran.output.split()) and "ticks" not in ran.output


@pytest.mark.long
@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="no Xvfb: apt install xvfb")
def test_a_window_on_a_real_display_opens_and_ends_with_ctrl_c(tmp_path):
    pytest.importorskip("pyvista")
    read, write = os.pipe()
    display = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x900x24"], pass_fds=[write],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    try:
        name = f":{os.read(read, 10).decode().strip()}"
        run = subprocess.Popen(
            [sys.executable, "-m", "palpate.launch", "run", "kidney", "--view", "--no-record", "--duration", "1",
             "--quiet", "--set", SETS[0]],
            stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, cwd=tmp_path,
            env=os.environ | {"DISPLAY": name, "XDG_RUNTIME_DIR": str(tmp_path)},
        )  # fmt: skip
        told = ""
        while "the view stays" not in told and (line := run.stderr.readline()):
            told += line
        assert "the view stays" in told, told
        run.send_signal(signal.SIGINT)
        assert run.wait(WAIT) == 0
    finally:
        display.kill()
        display.wait()
