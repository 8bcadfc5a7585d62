"""The page of a recording in a real Chromium: it plays, steps, scrubs, by mouse and keys, two side by side."""

import shutil

import pytest
from browser import NEEDED, opened

pytest.importorskip("websockets")
pytest.importorskip("playwright.sync_api")

from test_view import SETS

from palpate.launch.loading.launchfile import find
from palpate.launch.page.shown import Shown
from palpate.launch.running.execute import execute

pytestmark = NEEDED


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    file = tmp_path_factory.mktemp("view") / "touch.mcap"
    execute(find("kidney").but(record=file, place="fused", overrides=SETS, duration=0.7))
    other = shutil.copy(file, file.with_name("other.mcap"))
    made = Shown([file, file.parent / other])
    yield made
    made.close()


@pytest.fixture
def page(shown):
    with opened(
        shown.address, "window.palpate && palpate.reels.length == 2 && palpate.reels.every((r) => r.newest)"
    ) as page:
        yield page


def test_the_slider_goes_to_a_time_and_both_are_there(page):
    page.evaluate("const t = document.getElementById('time'); t.value = 0.3; t.dispatchEvent(new Event('input'))")
    page.wait_for_function(
        "palpate.reels.every((r) => Math.abs(r.newest.head.time - 0.3) < 0.002 && r.scene.moved.length)"
    )
    assert page.locator("output.force").count() == 2
    assert float(page.locator("output.force").first.text_content()) > 0.3
    assert page.problems == []


def test_it_plays_to_the_end_and_stops(page):
    page.select_option("#speed", "4")
    page.click("#play")
    page.wait_for_function("!palpate.playing && palpate.time > 0.69")
    assert page.get_attribute("#play", "aria-pressed") == "false" and page.problems == []


def test_keys_step_play_and_turn(page):
    page.focus("canvas.scene")
    page.keyboard.press(".")
    page.wait_for_function("Math.abs(palpate.time - 0.001) < 1e-6")
    page.keyboard.press(",")
    page.wait_for_function("palpate.time == 0")
    before = page.evaluate("palpate.reels.map((r) => r.scene.azimuth)")
    page.keyboard.press("ArrowLeft")
    after = page.evaluate("palpate.reels.map((r) => r.scene.azimuth)")
    assert after[0] != before[0] and after[0] == after[1]
    page.keyboard.press(" ")
    page.wait_for_function("palpate.playing")
    assert page.problems == []
