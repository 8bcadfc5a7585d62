"""Several fingers on the page: their display in a run and in a recording, and the finger that a pointer steers."""

import json

import numpy as np
import pytest
from browser import NEEDED, opened

pytest.importorskip("websockets")

from test_page import Server, read, until

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.changed import change_plan
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.views.errors import PageError
from palpate.views.page.reel import RecordingSource
from palpate.views.page.steered import steer_launch

THUMB, INDEX = (-0.026, -0.022, 0.084), (-0.020, 0.021, 0.084)
SMALL = "scene.surface.vertices=1500"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    made = Server(tmp_path_factory.mktemp("touch"), "pinch", SMALL)
    yield made
    made.close()


def pressed(head):
    return head["kind"] == "frame" and head["load"] > 0.3 and head["others"][0]["load"] > 0.3


def test_two_pointers_hold_the_organ_and_the_recording_replays(server):
    with server.open() as client:
        mesh, *_ = until(client, lambda head: head["kind"] == "mesh")
        assert mesh["fingers"] == ["contact-thumb", "contact-index"] and len(mesh["begins"]) == 2
        assert mesh["bodies"] == ["deformation.MassSpring", "deformation.BeamBundle", "deformation.ReducedFE"]
        client.send(json.dumps({"point": [1, THUMB, 1]}))
        head, *_ = until(client, pressed, {"point": [2, INDEX, 1], "finger": 1})
        other = head["others"][0]
        assert head["tip"][1] < -0.015 and other["tip"][1] > 0.015
        assert head["force"][1] < -0.2 and other["force"][1] > 0.2
        assert len(head["t"]) == len(head["f"]) and len(other["t"]) == len(other["s"])
        client.send(json.dumps({"point": [3, INDEX, 1], "finger": 2}))
        refused = {}
        while refused.get("kind") != "refused":
            data = client.recv(timeout=90)
            refused = json.loads(data) if isinstance(data, str) else {}
        assert "finger: found 2, expected less than 2" in refused["text"]
    with server.open() as watcher:  # the steering page has closed, so both hands return
        until(watcher, lambda h: h["kind"] == "frame" and h["load"] == 0.0 and h["others"][0]["load"] == 0.0)
        watcher.send(json.dumps({"reset": True}))
        until(watcher, lambda h: h["kind"] == "frame" and len(server.session.kept) == 1)
    recording = Recording(server.session.kept[0])
    report = verify(recording, change_plan(recording))
    assert report.ok, report.first


def test_a_recording_shows_all_fingers(tmp_path):
    path = tmp_path / "pinch.mcap"
    assert execute(find("pinch").but(record=path, place="fused", duration=0.8, overrides=(SMALL,))).result.ok
    source = RecordingSource(path)
    begin, *_ = read(source.begin(0, "pinch"))
    assert len(begin["others"]) == 1 and max(begin["others"][0]["f"]) > 0.8
    head, nodes, moved, _ = read(source.frame(0.75, 0))
    source.close()
    assert head["load"] > 0.8 and head["others"][0]["load"] > 0.8 and head["tip"][1] * head["others"][0]["tip"][1] < 0
    assert len(head["patch"]) == len(head["loads"]) and sum(head["loads"]) > 1.6
    assert np.linalg.norm(moved.reshape(-1, 3), axis=1).max() > 3e-3 and len(nodes)


def test_a_device_without_a_finger_is_an_error(tmp_path):
    path = tmp_path / "more.yaml"
    path.write_text("extends: kidney\nnodes: {idle: {use: device.Simulated, begin: [0, 0, 0.116]}}\n")
    with pytest.raises(PageError, match="found device, idle, expected one for each of 1 fingers"):
        steer_launch(find(str(path)), tmp_path)


class TestBrowser:
    pytestmark = NEEDED

    def test_one_mouse_moves_both_fingers_and_then_only_one(self, server):
        pytest.importorskip("playwright.sync_api")
        with opened(server.url(), "window.palpate && palpate.newest") as page:
            page.mouse.move(430, 300)
            page.mouse.down()
            page.wait_for_function("palpate.newest.load > 0.3 && palpate.newest.others[0].load > 0.3")
            opposed = "palpate.newest.normal.reduce((sum, x, i) => sum + x * palpate.newest.others[0].normal[i], 0)"
            assert page.evaluate(opposed) < -0.5
            page.focus("#view")
            page.keyboard.press("2")
            page.mouse.up()
            page.wait_for_function("palpate.newest.load > 0.3 && palpate.newest.others[0].load == 0")
            assert page.input_value("#finger") == "1"
            page.keyboard.press("0")
            page.wait_for_function("palpate.newest.load == 0")
            assert page.problems == []
