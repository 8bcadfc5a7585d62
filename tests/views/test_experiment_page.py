"""An experiment on the page with real runs: with a client of the socket, and in Chromium."""

import json
import time
from contextlib import ExitStack

import pytest

from palpate.engine.faults import GraphError
from palpate.records.changed import change_plan
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.studies.psychophysics import page as experiment_page
from palpate.studies.psychophysics.opening import open_sitting

pytest.importorskip("websockets")

from browser import NEEDED
from browser import opened as browsed
from websockets.sync.client import connect

from palpate.views.page.server import PageServer

WAIT = 90.0  # [s] timeout on a busy machine
TEXT = """\
graph: GRAPH
duration: 0.5 s
vary: tissue.stiffness
reference: 3e3
response: 2afc
question: Which was stiffer?
instructions: Press both.
gap: 0
blocks:
  main: {procedure: constant, levels: [4e3], repeats: 2}
"""
PRESSED = (0.0, 0.0, 0.101)


class Client:
    """Acts on the socket like the page's script."""

    def __init__(self, server):
        host = f"127.0.0.1:{server.port}"
        self._opened = connect(
            f"ws://{host}/socket?token={server.token}", origin=f"http://{host}", max_size=None, compression=None
        )
        self.socket = self._opened.__enter__()
        self.loads, self.done = [], 0

    def send(self, **order):
        self.socket.send(json.dumps(order))

    def until(self, fits):
        """The first new panel for which `fits` is true; presses meanwhile."""
        end = time.monotonic() + WAIT
        while time.monotonic() < end:
            data = self.socket.recv(timeout=WAIT)
            if isinstance(data, bytes):
                head = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
                self.loads.append(head.get("load", 0.0))
                self.send(point=[len(self.loads), PRESSED, 1])
            elif (printed := json.loads(data)).get("kind") == "status":
                panel = printed["panel"]
                if panel.get("shown", 0) > self.done and fits(panel):
                    self.done = panel["shown"]
                    return panel
        raise AssertionError("the panel did not appear")

    def next_panel(self):
        """Confirm the next text."""
        panel = self.until(lambda panel: panel.get("buttons") and panel["text"])
        self.send(shown=panel["shown"])
        return panel

    def answer(self, answer):
        panel = self.until(lambda panel: panel.get("title") == "Which was stiffer?")
        self.send(shown=panel["shown"], answer=answer, seconds=0.25)
        return panel

    def close(self):
        self._opened.__exit__(None, None, None)


@pytest.fixture
def begun(write, tmp_path):
    """Opens a session on a page, and closes it after the test."""
    there = ExitStack()

    def begin(graph="kidney", *sets, text=TEXT):
        file = write("mine.yaml", text.replace("GRAPH", graph))
        opening = open_sitting(str(file), tmp_path / "out", None, None, list(sets), True, lambda text: None)
        sitting = there.enter_context(opening)
        page = sitting.page()
        server = PageServer(page)
        there.callback(server.close)
        return sitting, page, server

    with there:
        yield begin


def wait_for(what):
    end = time.monotonic() + WAIT
    while not what():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_each_trial_has_one_answer_and_two_recordings(begun):
    sitting, page, server = begun()
    client = Client(server)
    assert client.next_panel()["text"] == "Press both."
    for answer in ("first", "second"):
        client.answer(answer)
    wait_for(lambda: page.ended)
    page.check()
    assert sitting.ended and [row["response"] for row in sitting.table.rows] == ["first", "second"]
    assert {row["response_time"] for row in sitting.table.rows} == {"0.250"}
    assert max(client.loads) > 0.05
    for row in sitting.table.rows:
        for name in ("recording_1", "recording_2"):
            recording = Recording(sitting.folder / row[name])
            assert verify(recording, change_plan(recording, ())).ok
    client.close()


@pytest.mark.long
def test_closing_the_page_in_an_interval_repeats_the_trial(begun):
    sitting, page, server = begun(
        text=TEXT.replace("0.5 s", "20 s").replace("repeats: 2", "repeats: 1") + "end_key: e\n"
    )
    client = Client(server)
    client.next_panel()
    client.until(lambda panel: panel.get("interval"))
    client.send(point=[1, PRESSED, 1])
    client.close()
    client = Client(server)
    assert "The page was closed" in client.next_panel()["text"]
    for _ in range(2):
        panel = client.until(lambda panel: panel.get("interval"))
        client.send(shown=panel["shown"])  # the key that ends an interval
    client.answer("second")
    wait_for(lambda: page.ended)
    (row,) = sitting.table.rows
    assert row["repeats"] == "1" and row["recording_1"].endswith("_repeat-1.mcap")
    client.close()


@pytest.mark.long
def test_late_answers_are_ignored_and_unknown_words_rejected(begun):
    sitting, _, server = begun()
    client = Client(server)
    welcome = client.next_panel()
    panel = client.until(lambda panel: panel.get("title") == "Which was stiffer?")
    client.send(shown=welcome["shown"], answer="first")
    client.send(shown=panel["shown"], answer="third")
    printed = ""
    while "refused" not in printed:
        data = client.socket.recv(timeout=WAIT)
        printed = data if isinstance(data, str) else ""
    assert "expected one of the answers that are shown" in printed and not sitting.table.rows
    client.close()


def test_unplugging_the_device_repeats_the_trial_with_a_notice(begun, monkeypatch):
    run, calls = experiment_page.execute, []

    def unplugged_once(launch, graph, **given):
        calls.append(launch)
        if len(calls) == 1:
            launch = launch.but(overrides=["device.faults={unplug: 0.2}"])
            graph = launch.load()
        return run(launch, graph, **given)

    monkeypatch.setattr(experiment_page, "execute", unplugged_once)
    text = TEXT.replace("repeats: 2", "repeats: 1")
    sitting, page, server = begun("falcon", "device.port=emulator", text=text)
    client = Client(server)
    client.next_panel()
    printed = client.next_panel()
    assert printed["title"] == "Trial 1 is repeated" and "Novint Falcon is gone" in printed["text"]
    client.answer("first")
    wait_for(lambda: page.ended)
    (row,) = sitting.table.rows
    assert row["repeats"] == "1" and row["response"] == "first"
    client.close()


def test_an_unknown_setting_of_the_hand_is_reported_before_the_first_trial(begun):
    text = TEXT.replace("vary: tissue.stiffness", "vary: device.speed_factor").replace("3e3", "1").replace("4e3", "2")
    with pytest.raises(GraphError, match="setting 'speed_factor': unknown"):
        begun(text=text)


def test_reloading_the_page_does_not_reset_the_response_time(begun):
    sitting, page, server = begun(text=TEXT.replace("repeats: 2", "repeats: 1"))
    client = Client(server)
    client.next_panel()
    client.until(lambda panel: panel.get("interval"))
    before = time.monotonic()
    client.until(lambda panel: panel.get("title") == "Which was stiffer?")
    asked = time.monotonic()
    client.close()
    wait_for(lambda: not page._pages and time.monotonic() > asked + 0.3)
    client = Client(server)
    client.answer("first")  # with a response time of 0.25 s
    wait_for(lambda: page.ended)
    (row,) = sitting.table.rows
    assert 0.3 <= float(row["response_time"]) < time.monotonic() - before
    assert row["repeats"] == "0"  # both intervals were felt once
    client.close()


@pytest.mark.parametrize("mark", [pytest.param("", marks=NEEDED)])
def test_the_page_reports_a_lost_connection_only_during_the_session(begun, mark):
    _, _, server = begun()
    with browsed(server.address, "document.querySelector('#panel button')") as window:
        server.close()
        window.wait_for_function("document.getElementById('panel').innerText.includes('The connection is lost')")
        assert "experimenter" in window.inner_text("#panel")


@pytest.mark.long
def test_closing_the_server_in_a_trial_leaves_the_trial_unanswered(begun):
    sitting, page, server = begun()
    client = Client(server)
    client.next_panel()
    client.answer("first")
    client.until(lambda panel: panel.get("interval"))
    server.close()
    assert page.ended and not sitting.ended and len(sitting.table.rows) == 1
    page.check()


@pytest.mark.parametrize("mark", [pytest.param("", marks=NEEDED)])
def test_a_whole_session_in_chromium(begun, mark):
    text = TEXT.replace("0.5 s", "60 s") + "end_key: Enter\nanswers: {first: f, second: j}\nshow: [deformation]\n"
    sitting, page, server = begun(text=text)
    with browsed(server.address, "document.querySelector('#panel button')") as window:
        assert "Press both." in window.inner_text("#panel") and "trial 1 of 2" in window.inner_text("#status")
        window.keyboard.press("Enter")
        for number, key in enumerate("fj"):
            for interval in (1, 2):
                window.wait_for_selector("body.interval")
                window.wait_for_function("window.palpate.newest")
                assert window.is_hidden("#panel") and window.is_hidden("#numbers") and window.is_hidden("#body")
                assert f"interval {interval} of 2" in window.inner_text("#status")
                window.mouse.move(500, 330)
                window.mouse.down()
                window.wait_for_function("palpate.newest.load > 0.1 && palpate.newest.force[2] == 0")
                window.mouse.up()
                window.keyboard.press("Enter")
                window.wait_for_selector("body:not(.interval)")
            window.wait_for_function("document.querySelectorAll('#panel button').length == 2")
            if number:
                window.click("#panel button:last-of-type")
            else:
                window.keyboard.press(key)
        window.wait_for_function("document.getElementById('panel').innerText.includes('Thank you.')")
        assert window.problems == []
    wait_for(lambda: page.ended)
    page.check()
    assert [row["response"] for row in sitting.table.rows] == ["first", "second"]
    assert all(float(row["response_time"]) > 0.0 for row in sitting.table.rows)
