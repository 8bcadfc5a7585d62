"""A recording on a page: each time shows the last messages before it; unusable files are errors."""

import json
import socket
import urllib.error
import urllib.request

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.format.mcap_file import MAGIC, McapRecords, messages
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError
from palpate.views.run import Run

pytest.importorskip("websockets")

from shell_text import unwrapped
from test_page import read
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from palpate.messages import Surface
from palpate.views.errors import PageError
from palpate.views.page.feed import frame
from palpate.views.page.reel import POINTS, RecordingSource, Reels
from palpate.views.page.server import PageServer

SETS = ("scene.surface.vertices=1000", "scene.hand.begin=[0, 0, 0.111]",
        "scene.hand.path=[{to: [0, 0, 0.098], time: 0.3}, {to: [0, 0, 0.112], time: 0.3}]")  # fmt: skip


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "touch.mcap"
    execute(find("kidney").but(record=path, place="fused", overrides=SETS, duration=0.7))
    return path


@pytest.fixture
def shown(file):
    page = PageServer(Reels([file, file]))
    yield page
    page.close()


def test_any_time_shows_the_last_messages_before_it(file):
    reel, contact = RecordingSource(file), Recording(file).columns("contact")
    surfaces = {m.tick: m for m in Recording(file).messages("tissue")}
    for time in np.random.default_rng(1).uniform(0.0, 0.7, 40).tolist() + [0.0, 0.25, 5.0, -1.0]:
        head, nodes, moved, _ = read(reel.frame(time, 1))
        tick = min(max(int(np.searchsorted(contact["time"], min(max(time, 0), 0.699) + 1e-12)) - 1, 0), 699)
        assert head["reel"] == 1 and head["asked"] == time
        assert head["load"] == contact["force"][tick] and head["depth"] == contact["indentation"][tick]
        assert nodes.tolist() == surfaces[tick].nodes.tolist()
        assert moved == pytest.approx(surfaces[tick].displacement.ravel(), rel=1e-6)
    reel.close()


def test_sliding_vertices_are_listed_if_the_body_sends_them():
    law = {"stiffness": 1.0, "exponent": 1.0, "damping": 0.0, "rest_indentation": 0.0, "previous_indentation": 0.0}
    body = {"nodes": np.array([3, 5], np.int32), "displacement": np.zeros((2, 3)), **law}
    assert read(frame({"kind": "frame"}, Surface(**body, slipped=np.array([0, 1]))))[0]["slipped"] == [0, 1]
    assert "slipped" not in read(frame({"kind": "frame"}, Surface(**body)))[0]


def test_the_first_message_has_the_mesh_and_the_curves(file):
    reel = RecordingSource(file)
    head, triangles, places, normals = read(reel.begin(0, "touch.mcap"))
    force = Recording(file).columns("contact")["force"]
    assert head["name"] == "touch.mcap" and head["body"] == "deformation.MassSpring"
    assert len(head["t"]) == len(force) < POINTS and max(head["f"]) == force.max() > 0.5
    assert places.reshape(-1, 3) == pytest.approx(reel.touched.bodies.mesh.vertices, abs=1e-7)
    assert len(triangles) == reel.touched.bodies.mesh.triangles.size and len(normals) == len(places)
    reel.close()


def test_a_long_recording_keeps_its_peaks(file, monkeypatch):
    monkeypatch.setattr("palpate.views.page.reel.POINTS", 50)
    reel = RecordingSource(file)
    assert (
        len(reel.curves[0]["t"]) == 50 and max(reel.curves[0]["f"]) == Recording(file).columns("contact")["force"].max()
    )
    assert reel.curves[0]["t"] == sorted(reel.curves[0]["t"]) and reel.curves[0]["t"][-1] == pytest.approx(0.699)
    reel.close()


def test_a_truncated_recording_is_shown_up_to_its_end(tmp_path):
    """Up to the last message before the chunk that is cut, at any times of the logger."""
    whole, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    execute(find("kidney").but(record=whole, place="fused", overrides=(*SETS, "log.within=0.02"), duration=0.7))
    with whole.open("rb") as file:
        file.seek(len(MAGIC))
        chunks = list(McapRecords(file).chunks())
    half = len(chunks) // 2
    cut.write_bytes(whole.read_bytes()[: chunks[half][0] + 100])
    last = max(time for _, chunk in chunks[:half] for _, _, time, _ in messages(chunk)) * 1e-9
    reel = RecordingSource(cut)
    assert len(chunks) > 1 and reel.curves[0]["t"][-1] == pytest.approx(last, abs=1.1e-3) and last < 0.69
    assert "--to mcap" in reel.recording.ending
    assert read(reel.frame(reel.curves[0]["t"][-1], 0))[0]["time"] == pytest.approx(reel.curves[0]["t"][-1])
    reel.close()


def talk(page, token=None, origin="http://127.0.0.1"):
    host, _, own = page.address.partition("/?token=")
    address = f"{host.replace('http', 'ws')}/socket?token={token or own}"
    return connect(address, origin=origin, max_size=None, compression=None)


def test_two_recordings_answer_each_request(shown):
    with talk(shown) as client:
        begun = [read(client.recv())[0]["reel"] for _ in range(2)]
        for at in (0.3, 0.05):
            client.send(json.dumps({"at": at}))
            heads = [read(client.recv())[0] for _ in range(2)]
            assert [h["reel"] for h in heads] == begun == [0, 1] and heads[0]["time"] == heads[1]["time"]
            assert heads[0]["time"] == pytest.approx(at, abs=1.1e-3)
        for at in ('"soon"', "1e400", str(10**400)):
            client.send(f'{{"at": {at}}}')
            assert json.loads(client.recv())["kind"] == "refused"
        for at in (-1e23, 10**23):
            client.send(json.dumps({"at": at}))
            assert [read(client.recv())[0]["reel"] for _ in range(2)] == [0, 1]


@pytest.mark.parametrize(
    "head",
    [b"GET /%s HTTP/1.1\r\nOrigin: http://[::1", b"GET /%s HTTP/1.1\r\nOrigin: http://127.0.0.1\r\nOrigin: null"],
)
def test_a_malformed_request_is_answered_without_a_traceback(shown, head, caplog):
    host, _, token = shown.address.removeprefix("http://").partition("/")
    rest = ("Host: 127.0.0.1", "Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "", "")  # fmt: skip
    with socket.create_connection((host.partition(":")[0], int(host.partition(":")[2])), timeout=60.0) as plain:
        plain.sendall(head.replace(b"%s", token.encode()) + b"\r\n" + "\r\n".join(rest).encode())
        assert plain.recv(1000).startswith(b"HTTP/1.1 400 ")
    assert not [record for record in caplog.records if record.exc_info]


def test_clients_without_a_token_are_refused(shown):
    with pytest.raises(InvalidStatus, match="403"):
        talk(shown, token="guess")
    with pytest.raises(InvalidStatus, match="403"):
        talk(shown, origin="http://example.org")
    host = shown.address.partition("?")[0]
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(host)
    page = urllib.request.urlopen(shown.address).read().decode()
    for name in ("view.js", "scene.js", "charts.js", "page.css"):
        assert urllib.request.urlopen(host + name).status == 200
    assert "view.js" in page


def test_view_from_python(file):
    page = Run(file).view(show=False)
    assert page.address in page._repr_html_() and urllib.request.urlopen(page.address).status == 200
    page.close()
    page.close()


def test_unusable_recordings_are_errors_of_one_line(file, tmp_path, shown):
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(b"")
    bare = tmp_path / "bare.mcap"
    execute(find("kidney").but(record=bare, place="fused", overrides=SETS, duration=0.05), leave_out=["tissue"])
    for files, printed in (
        ([tmp_path / "none.mcap"], "No such file"),
        ([empty], "empty file"),
        ([bare], "no body in it"),
        ([file] * 3, "expected one, or two"),
    ):
        ran = CliRunner().invoke(app, ["view", *map(str, files), "--no-open"])
        assert ran.exit_code != 0 and printed in unwrapped(ran.output) and "Traceback" not in ran.output
    with pytest.raises(PageError, match="port"):
        PageServer(Reels([file]), port=int(shown.address.partition("1:")[2].partition("/")[0]))
    with pytest.raises(RecordingError, match="no body"):
        RecordingSource(bare)
