"""`palpate run --view`: an active run in the browser."""

import json
import os
import re
import signal
import time

import numpy as np
import pytest
from typer.testing import CliRunner
from warm_fork_server import palpate

pytest.importorskip("websockets")

from shell_text import unwrapped
from test_page import read
from websockets.sync.client import connect

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.views.page.live import watchable

SETS = ("scene.surface.vertices=1000",)
WAIT = 90.0
"""[s] timeout on a busy machine."""


@pytest.fixture
def watched(tmp_path):
    """A run of 2 s in several processes without a recording, and its address."""
    environment = os.environ | {"BROWSER": "true", "XDG_RUNTIME_DIR": str(tmp_path)}
    command = ["run", "kidney", "--view", "--no-record", "--duration", "2", "--quiet", "--set", SETS[0]]
    reading, writing = os.pipe()
    with open(writing, "wb") as errors, open(tmp_path / "out", "wb") as out:
        run = palpate(command, cwd=tmp_path, env=environment, stdout=out, stderr=errors)
    with open(reading) as printed:
        yield run, re.search(r"http://(\S+)/\?token=(\S+)", printed.readline())
        if run.poll() is None:
            run.send_signal(signal.SIGINT)
            run.wait(WAIT)


def test_the_page_follows_the_run_and_stays_until_it_is_closed(watched):
    run, address = watched
    host, token = address.groups()
    heads, printed, moved = [], [], 0.0
    with connect(f"ws://{host}/socket?token={token}", origin=f"http://{host}", max_size=None) as socket:
        until = time.monotonic() + WAIT
        while time.monotonic() < until and "the run has ended" not in printed:
            data = socket.recv(timeout=WAIT)
            if isinstance(data, str):
                printed.append(json.loads(data)["text"])
                continue
            head, _, first, _ = read(data)
            heads.append(head)
            if head["kind"] == "frame" and len(first):
                moved = max(moved, float(np.abs(first).max()))
        assert run.poll() is None
    assert heads[0]["kind"] == "mesh" and heads[0]["watch"]
    frames = [head for head in heads if head["kind"] == "frame"]
    assert len(frames) > 5 and [h["time"] for h in frames] == sorted(h["time"] for h in frames)
    assert max(head["load"] for head in frames) > 0.5
    assert moved > 1e-3, "the shape is computed without a recording"
    assert printed[-2:] == ["running", "the run has ended"]
    assert run.wait(WAIT) == 0, "the only page was closed"


def test_the_shape_is_computed_and_the_pace_is_real_time():
    launch = watchable(find("kidney"))
    assert launch.pace == 1.0 and "effects.shape=on" in launch.overrides
    assert watchable(find("kidney").but(pace=0.2)).pace == 0.2
    assert watchable(find("kidney").but(clock="real")).pace is None
    assert "effects.shape=on" in watchable(find("fingertip-slide")).overrides


def test_a_fused_run_has_no_view():
    ran = CliRunner().invoke(app, ["run", "kidney", "--view", "--fused"])
    assert ran.exit_code == 2 and "leave out --fused" in unwrapped(ran.output)


def test_a_graph_without_a_surface_is_an_error_before_the_run(tmp_path, monkeypatch):
    monkeypatch.setenv("BROWSER", "true")
    ran = CliRunner().invoke(app, ["run", "fingertip-slide", "--view", "--no-record"])
    assert ran.exit_code == 2 and "no mesh to show" in unwrapped(ran.output) and "ticks" not in ran.output
