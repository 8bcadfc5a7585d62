"""Frames for external renderers: a client decodes them with docs/renderers.md alone; the sample clients run."""

import os
import shutil
import socket
import struct
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, opened
from strangers import Listening, answer
from three_js import served, unpack_three

pytest.importorskip("websockets")

from test_page import PRESSED, WAIT, Server, until
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from palpate.views.page.feed import binary, pack_message

SAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "renderers"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    made = Server(tmp_path_factory.mktemp("touch"))
    yield made
    made.close()


def listen(server, origin=None, token=None):
    address = server.url("/frames", token).replace("http", "ws", 1)
    return connect(address, origin=origin, max_size=None, compression=None)


def decode(data):
    """Decode a message as specified in docs/renderers.md, without code of palpate."""
    magic, version, fingers, count = struct.unpack_from("<4sHHI", data)
    assert version == 1
    if magic == b"PLPM":
        triangles, thickness, reserved = struct.unpack_from("<IfI", data, 12)
        vertices = np.frombuffer(data, "<f4", 3 * count, 24).reshape(-1, 3)
        corners = np.frombuffer(data, "<u4", 3 * triangles, 24 + 12 * count).reshape(-1, 3)
        assert len(data) == 24 + 12 * count + 12 * triangles and reserved == 0
        return {"magic": magic, "fingers": fingers, "thickness": thickness, "vertices": vertices, "corners": corners}
    assert magic == b"PLPF"
    late, time = struct.unpack_from("<Id", data, 12)
    rows = np.frombuffer(data, "<f4", 16 * fingers, 24).reshape(-1, 16)
    names = {"tip": rows[:, :3], "foot": rows[:, 3:6], "normal": rows[:, 6:9], "force": rows[:, 9:12]}
    names |= {"load": rows[:, 12], "indentation": rows[:, 13], "compression": rows[:, 14]}
    at = 24 + 64 * fingers
    assert len(data) == at + 16 * count
    return names | {
        "magic": magic, "late": late, "time": time, "state": rows[:, 15].copy().view("<u4"),
        "nodes": np.frombuffer(data, "<u4", count, at),
        "moved": np.frombuffer(data, "<f4", 3 * count, at + 4 * count).reshape(-1, 3),
    }  # fmt: skip


def becomes(server, rate):
    """Whether the session reaches this frame rate [1/s]."""
    end = time.monotonic() + WAIT
    while server.session.rate != rate and time.monotonic() < end:
        time.sleep(0.02)
    return server.session.rate == rate


def test_each_number_is_at_its_documented_position():
    finger = {"foot": [1, 2, 3], "normal": [0, 0, 1], "load": 0.5, "depth": 4e-3, "squeeze": 1e-3}
    first = finger | {"tip": [4, 5, 6], "force": [0.1, 0.2, 0.3], "stick": True}
    other = finger | {"load": 0.0, "stick": False}
    head = {"kind": "frame", "late": 7, "time": 1.25, **first, "others": [other]}
    moved = np.arange(6, dtype="<f4")
    frame = decode(binary(pack_message(head, np.array([3, 9], "<u4"), moved, np.ones(2, "<f4"))))
    assert (frame["late"], frame["time"], frame["nodes"].tolist()) == (7, 1.25, [3, 9])
    assert frame["moved"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert frame["foot"].tolist() == [[1, 2, 3]] * 2
    assert frame["tip"].tolist() == [[4, 5, 6], [1, 2, 3]]  # the foot point if the tip is unknown
    assert frame["force"] == pytest.approx(np.array([[0.1, 0.2, 0.3], [0, 0, 0]]), rel=1e-6)
    assert frame["load"].tolist() == [0.5, 0.0]
    assert frame["indentation"] == pytest.approx([4e-3] * 2)
    assert frame["state"].tolist() == [1 + 2 + 4 + 8 + 16, 8]
    corners, places = np.array([0, 1, 2, 2, 1, 3], "<u4"), np.arange(12, dtype="<f4")
    printed = {"kind": "mesh", "fingers": ["a", "b"], "thickness": 4e-3}
    mesh = decode(binary(pack_message(printed, corners, places, places)))
    assert mesh["vertices"].tolist() == places.reshape(-1, 3).tolist()
    assert mesh["corners"].tolist() == [[0, 1, 2], [2, 1, 3]]
    assert (mesh["fingers"], mesh["thickness"]) == (2, pytest.approx(4e-3))


def test_a_client_receives_the_deformation_and_can_steer(server):
    with server.open() as page, listen(server) as client:
        shown = until(page, lambda head: head["kind"] == "mesh")
        mesh = frame = None
        number = 0
        # pressed, and the surface has had time to deform
        while frame is None or frame["load"][0] < 0.3 or frame["moved"][:, 2].min() > -5e-4:
            number += 1
            client.send(f'{{"point": [{number}, {list(PRESSED)}, 1]}}')
            data = client.recv(timeout=WAIT)
            if isinstance(data, str):
                continue
            printed = decode(data)
            mesh, frame = (printed, frame) if printed["magic"] == b"PLPM" else (mesh, printed)
    np.testing.assert_array_equal(mesh["vertices"].ravel(), shown[2])
    np.testing.assert_array_equal(mesh["corners"].ravel(), shown[1])
    deepest = mesh["vertices"][frame["nodes"][np.linalg.norm(frame["moved"], axis=1).argmax()]]
    assert np.linalg.norm((deepest - PRESSED)[:2]) < 0.006
    assert frame["state"][0] & 7 == 7
    assert frame["force"][0, 2] > 0.1
    assert np.linalg.norm(frame["tip"][0] - frame["foot"][0]) < 0.01


def test_the_frame_rate_is_higher_only_while_a_renderer_listens(server):
    assert becomes(server, 30.0)  # the server may still close the previous connection
    with listen(server) as one, listen(server):
        one.recv(timeout=WAIT)
        assert server.session.rate == 60.0
    assert becomes(server, 30.0)


def test_a_missing_token_or_a_foreign_page_is_refused(server):
    for token, origin in (("", None), ("wrong", None), (None, "http://evil.example"), (None, "null")):
        with pytest.raises(InvalidStatus) as refused, listen(server, origin, token):
            pass
        assert refused.value.response.status_code == 403
    with listen(server, origin="http://localhost:8000") as client:
        client.recv(timeout=WAIT)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be another user")
def test_another_user_with_the_token_is_refused(server):
    """The token is an argument of the browser, and every user can list the processes."""
    host = server.url().split("/")[2]
    there = Listening(socket.AF_INET, socket.SOCK_STREAM, "127.0.0.1", int(host.partition(":")[2]))
    for path in ("/", "/frames", "/socket", "/page.css"):
        target = server.url(path).split(host)[1]
        keys = "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        upgrade = "" if path in ("/", "/page.css") else f"Connection: Upgrade\r\nOrigin: http://{host}\r\n{keys}"
        request = f"GET {target} HTTP/1.1\r\nHost: {host}\r\n{upgrade}\r\n".encode()
        assert answer(there, request).startswith(b"HTTP/1.1 403"), path
        with socket.create_connection(("127.0.0.1", there.port), WAIT) as own:
            own.sendall(request)
            assert own.recv(100).split(b" ")[1] in (b"200", b"101"), path


@pytest.mark.long
@pytest.mark.skipif(not (shutil.which("mcs") and shutil.which("mono")), reason="no Mono: apt install mono-mcs")
def test_the_client_in_c_sharp_compiles_and_reads_frames(server, tmp_path):
    source, program = SAMPLES / "PalpateClient.cs", tmp_path / "client.exe"
    assert len(source.read_text().splitlines()) <= 150
    library = ["mcs", "-warnaserror", "-target:library", f"-out:{tmp_path / 'client.dll'}", str(source)]  # as in Unity
    subprocess.run(library, check=True, timeout=WAIT)
    subprocess.run(["mcs", "-define:CONSOLE", f"-out:{program}", str(source)], check=True, timeout=WAIT)
    with listen(server) as client:
        mesh = next(
            printed for printed in map(decode, iter(lambda: binary_of(client), None)) if printed["magic"] == b"PLPM"
        )
        client.send(f'{{"point": [1, {list(PRESSED)}, 1]}}')
        while (printed := decode(binary_of(client)))["magic"] != b"PLPF" or printed["load"][0] < 0.3:
            client.send(f'{{"point": [2, {list(PRESSED)}, 1]}}')
        done = subprocess.run(["mono", program, server.url(), "20"], capture_output=True, text=True, timeout=WAIT)
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert len(rows) >= 20
    times = [float(row[0]) for row in rows]
    assert times == sorted(times)
    assert {int(row[1]) for row in rows} == {len(mesh["vertices"])}
    assert all(int(row[2]) > 3 and float(row[3]) > 0.2 and int(row[5]) & 7 == 7 for row in rows)
    wrong = subprocess.run(
        ["mono", program, server.url(token="wrong"), "1"], capture_output=True, text=True, timeout=WAIT
    )
    assert wrong.returncode != 0
    assert "WebSocketException" in wrong.stderr


def binary_of(client):
    while isinstance(data := client.recv(timeout=WAIT), str):
        pass
    return data


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """The address of the three.js client, served as its header describes."""
    folder = tmp_path_factory.mktemp("samples")
    shutil.copy(SAMPLES / "three.html", folder)
    unpack_three(folder)
    with served(folder) as address:
        yield f"{address}/three.html"


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt install chromium")
def test_the_client_in_three_js_shows_the_deformation_under_the_mouse(server, samples):
    pytest.importorskip("playwright.sync_api")
    assert len((SAMPLES / "three.html").read_text().splitlines()) <= 150
    with opened(f"{samples}#{server.url()}", "window.client && client.frames > 3") as page:
        page.mouse.move(500, 345)
        page.mouse.down()
        page.mouse.wheel(0, -500)  # 5 mm
        until_then = time.monotonic() + WAIT
        while not page.evaluate("client.newest.normalForce > 0.3 && client.newest.moved > 3"):
            assert time.monotonic() < until_then
            page.mouse.move(500 + int(10 * time.monotonic()) % 5, 345)
            time.sleep(0.1)
        bent = "client.places.some((x, i) => Math.abs(x - client.rest()[i]) > 5e-4)"
        page.wait_for_function(bent)
        assert page.evaluate("client.newest.state & 7") == 7
        assert page.locator("#vr").is_hidden()  # no headset here
        page.mouse.up()
        assert page.problems == []
