"""The page's server with a real run and real clients: frames, steering, and rejected clients."""

import contextlib
import json
import re
import struct
import time
import urllib.error
import urllib.request
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from palpate.bases import build_missing
from palpate.cli.terminal.browser import show
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile
from palpate.records.changed import change_plan
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.views.errors import PageError
from palpate.views.page.session import Session
from palpate.views.page.steered import steer_launch

pytest.importorskip("websockets")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from palpate.views.page.feed import FrameSource
from palpate.views.page.server import PageServer

WAIT = 90.0  # [s] timeout on a busy machine
PRESSED = (0.0, 0.0, 0.101)


class Server:
    """A page and its session."""

    def __init__(self, folder, graph="kidney", *sets, organ=None):
        launch = find(graph).but(organ=organ).settle_organ()
        self.session = Session(launch, folder, list(sets), build=lambda *given: build_missing(given[0], begin=given[1]))
        self.page = PageServer(self.session)

    def close(self):
        self.page.close()

    def url(self, path="/", token=None):
        return f"http://127.0.0.1:{self.page.port}{path}?token={self.page.token if token is None else token}"

    def open(self, token=None, origin=None):
        address = self.url("/socket", token).replace("http", "ws", 1)
        return connect(address, origin=origin or f"http://127.0.0.1:{self.page.port}", max_size=None, compression=None)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    made = Server(tmp_path_factory.mktemp("touch"))
    yield made
    made.close()


def read(data):
    """Head and arrays of a binary message."""
    (length,) = struct.unpack_from("<I", data)
    head = json.loads(data[4 : 4 + length])
    a, b, c = head["sizes"]
    at = 4 + length
    return (head, np.frombuffer(data, "<u4", a, at), np.frombuffer(data, "<f4", b, at + 4 * a),
            np.frombuffer(data, "<f4", c, at + 4 * (a + b)))  # fmt: skip


def until(client, fits, send=None):
    """The first binary message for which `fits` is true."""
    end = time.monotonic() + WAIT
    while time.monotonic() < end:
        if send is not None:
            client.send(json.dumps(send))
        data = client.recv(timeout=WAIT)
        if isinstance(data, bytes):
            message = read(data)
            if fits(message[0]):
                return message
    raise AssertionError("the frame did not arrive")


def test_the_organ_deforms_under_the_pointer_until_the_page_closes(server):
    with server.open() as watcher:
        with server.open() as client:
            mesh = until(client, lambda head: head["kind"] == "mesh")
            places = mesh[2].reshape(-1, 3)
            assert mesh[1].max() == len(places) - 1
            press = {"point": [1, PRESSED, 1]}
            for _ in range(100):  # the first frames of a busy machine show the begin of the press
                head, nodes, moved, _ = until(client, lambda h: h["kind"] == "frame" and h["load"] > 0.3, press)
                moved = moved.reshape(-1, 3)
                if moved[:, 2].min() < -5e-4:
                    break
            assert np.isfinite(moved).all()
            deepest = places[nodes[np.linalg.norm(moved, axis=1).argmax()]]
            assert np.linalg.norm((deepest - PRESSED)[:2]) < 0.006
            assert moved[:, 2].min() < -5e-4
            assert head["sample"] == 1
            assert head["force"][2] > 0.1
            until(watcher, lambda h: h["kind"] == "frame" and h["load"] > 0.3)
        until(watcher, lambda h: h["kind"] == "frame" and h["load"] == 0.0 and h["sample"] == 0)


def test_a_hard_case_restarts_the_run_and_reset_returns(server):
    with server.open() as client:
        client.send(json.dumps({"hard": "soft"}))
        client.send(json.dumps({"hard": "stiff"}))
        head, *_ = until(client, lambda h: h["kind"] == "mesh" and h["case"] == "stiff")
        assert [one["name"] for one in head["hard"]] == ["stiff", "stab"] and head["limit"] == 9.0
        assert ["ledger", "energy.ledger is false (graphs/scenes/kidney.yaml:49)"] in head["plan"]["left_out"]
        press = {"point": [1, PRESSED, 1]}
        head, *_ = until(client, lambda h: h["kind"] == "frame" and h["load"] > 3.0 and h["cost"] > 0.0, press)
        assert np.linalg.norm(head["force"]) <= 9.0 and head["depth"] < 1e-3
        client.send(json.dumps({"reset": True}))
        until(client, lambda h: h["kind"] == "mesh" and h["case"] is None)


def test_a_missing_token_or_a_foreign_origin_is_refused(server):
    for token, origin in (("", None), ("wrong", None), (None, "http://evil.example"), (None, "null")):
        with pytest.raises(InvalidStatus) as refused, server.open(token, origin):
            pass
        assert refused.value.response.status_code == 403
    for url, status in ((server.url(token=""), 403), (server.url("/../secrets"), 404), (server.url("/page.py"), 404)):
        with pytest.raises(urllib.error.HTTPError) as error:
            urllib.request.urlopen(url, timeout=WAIT)
        assert error.value.code == status
        error.value.close()
    with urllib.request.urlopen(server.url(), timeout=WAIT) as page:
        assert b"<canvas" in page.read()


@pytest.mark.parametrize(
    "order",
    ["{", "[]", '{"point": [1, [0, 0], 0]}', '{"body": "os.system"}', '{"rest": 1}', '{"point": null, "x": 2}',
     f'{{"point": [{10**23}, [0, 0, 0.1], 0]}}', f'{{"point": [1, [0, 0, 0.1], {10**23}]}}',
     '{"point": [1, [0, 0, 1e23], 0]}', '{"point": [-1, [0, 0, 0.1], 0]}', "1" * 4000],
)  # fmt: skip
def test_an_invalid_request_is_rejected_and_the_page_continues(server, order):
    with server.open() as client:
        client.send(order)
        texts = []
        with contextlib.suppress(StopIteration):
            while not any(text["kind"] == "refused" for text in texts):
                data = client.recv(timeout=WAIT)
                texts += [json.loads(data)] if isinstance(data, str) else []
        until(client, lambda head: head["kind"] == "frame")


def test_a_port_in_use_is_an_error(server):
    with pytest.raises(PageError, match=str(server.page.port)):
        PageServer(FrameSource(), server.page.port)


def test_a_graph_without_a_hand_is_an_error(tmp_path):
    with pytest.raises(PageError, match="DeviceState"):
        steer_launch(find("softness"), tmp_path)


def test_a_device_that_was_changed_from_outside_is_replaced_by_the_hand(tmp_path):
    changed = ["device.use=device.RawHid", "device.ramp=0.2"]
    planned = steer_launch(find("cartesian").but(overrides=changed), tmp_path)[0].plan()
    assert planned.graph.nodes["device"].use == "device.Mouse"


@pytest.mark.parametrize("scene", ["afferents", "mine.yaml"])
def test_a_page_takes_a_scene_by_name_or_by_file(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("extends: afferents\n")
    planned = steer_launch(find("nodule").but(scene=scene), tmp_path)[0].plan()
    assert "afferents" in planned.order and "palpate-pointer" in planned.order


def test_another_body_starts_a_new_run_and_its_recording_replays(server):
    with server.open() as client:
        until(client, lambda head: head["kind"] == "frame" and head["load"] > 0.1, {"point": [7, PRESSED, 1]})
        client.send(json.dumps({"body": "deformation.ReducedFE"}))
        until(client, lambda head: head["kind"] == "mesh" and head["body"] == "deformation.ReducedFE")
        until(client, lambda head: head["kind"] == "frame" and head["load"] > 0.1, {"point": [8, PRESSED, 1]})
    recording = Recording(server.session.kept[0])
    report = verify(recording, change_plan(recording))
    assert report.ok
    assert report.nodes["device"].checked > 0, "the recording has only sources: the other streams are recomputed"


@pytest.mark.long
def test_switching_to_a_body_without_a_basis_builds_it(tmp_path, monkeypatch):
    trimesh = pytest.importorskip("trimesh")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    trimesh.creation.icosphere(1, 60.0).export(tmp_path / "ball.stl")
    said, say = [], Session.say
    monkeypatch.setattr(Session, "say", lambda self, status: said.append(status) or say(self, status))
    made = Server(tmp_path, organ=OrganFile(tmp_path / "ball.stl", "mm"))
    try:
        with made.open() as client:
            until(client, lambda head: head["kind"] == "mesh")
            client.send(json.dumps({"body": "deformation.ReducedFE"}))
            until(client, lambda head: head["kind"] == "mesh" and head["body"] == "deformation.ReducedFE")
    finally:
        made.close()
    assert any(text.startswith("building the basis: condensing, ") for text in said)
    assert not any("stopped" in text for text in said)
    assert len(list((tmp_path / "cache/palpate/bases").glob("ball-*.npz"))) == 1


def test_a_page_for_other_machines_requires_the_token_and_its_origin(capsys):
    source, host = FrameSource(), "127.0.0.2"  # represents an address on a network
    page = PageServer(source, host=host)
    try:
        assert page.address == f"http://{host}:{page.port}/?token={page.token}"
        address = f"ws://{host}:{page.port}/socket?token="
        with connect(address + page.token, origin=f"http://{host}:{page.port}"):
            pass
        for token, origin in (("wrong", f"http://{host}:{page.port}"), (page.token, "http://192.0.2.7")):
            with pytest.raises(InvalidStatus) as refused, connect(address + token, origin=origin):
                pass
            assert refused.value.response.status_code == 403
    finally:
        page.close()
    show(source, "see", 0, host, True, over=lambda: True)
    printed = capsys.readouterr()
    assert f"http://{host}:" in printed.out and "not encrypted" in printed.err
    show(source, "see", 0, "127.0.0.1", True, over=lambda: True)
    assert not capsys.readouterr().err


def test_an_address_of_another_machine_is_an_error():
    with pytest.raises(PageError, match=r"192\.0\.2\.7.*--host 0\.0\.0\.0"):
        PageServer(FrameSource(), host="192.0.2.7")


@pytest.mark.parametrize("name", ["index.html", "view.html"])
def test_ids_of_a_page_are_unique_and_each_force_is_named(name):
    text = resources.files("palpate.views.page").joinpath("static", name).read_text(encoding="utf-8")
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    names = re.findall(r"<label>([^<]+)</label><output", text)
    assert {"force on the hand", "normal force"} <= set(names) and "force" not in names
