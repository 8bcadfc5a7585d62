"""The page of a recording in a real Chromium: it plays, steps, scrubs, by mouse and keys, two side by side."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from browser import NEEDED, opened

pytest.importorskip("websockets")
pytest.importorskip("playwright.sync_api")

from test_view import SETS

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Surface
from palpate.views.page.reel import Reels
from palpate.views.page.server import PageServer
from palpate.views.surface.colour import COLOURS, paint_vertices
from palpate.views.surface.moments import displace_vertices, mean_drag

pytestmark = NEEDED


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    file = tmp_path_factory.mktemp("view") / "touch.mcap"
    (file.parent / "other").mkdir()
    execute(find("kidney").but(record=file, place="fused", overrides=SETS, duration=0.7))
    other = shutil.copy(file, file.parent / "other")
    made = PageServer(Reels([file, Path(other)]))
    yield made
    made.close()


@pytest.fixture
def page(shown):
    with opened(
        shown.address, "window.palpate && palpate.reels.length == 2 && palpate.reels.every((r) => r.newest)"
    ) as page:
        yield page


def test_the_slider_moves_both_recordings_to_a_time(page):
    page.evaluate("const t = document.getElementById('time'); t.value = 0.3; t.dispatchEvent(new Event('input'))")
    page.wait_for_function(
        "palpate.reels.every((r) => Math.abs(r.newest.head.time - 0.3) < 0.002 && r.scene.moved.length)"
    )
    assert page.locator("output.force").count() == 2
    assert float(page.locator("output.force").first.text_content()) > 0.3
    assert page.problems == []


def test_two_recordings_fit_a_phone(page):
    page.set_viewport_size({"width": 390, "height": 844})
    out = """() => [...document.querySelectorAll('.figures > *')].filter(
        (e) => e.getBoundingClientRect().right > e.closest('.card').getBoundingClientRect().right)"""
    page.wait_for_function(f"({out})().length == 0")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert min(box["height"] for box in map(lambda e: e.bounding_box(), page.locator(".scene").all())) > 200
    assert page.locator("#status").text_content() == "" and page.problems == []


def test_it_plays_to_the_end_and_stops(page):
    page.select_option("#speed", "4")
    page.click("#play")
    page.wait_for_function("!palpate.playing && palpate.time > 0.69")
    assert page.get_attribute("#play", "aria-pressed") == "false" and page.problems == []


def test_keys_step_play_and_rotate(page):
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


def at(page, time):
    """Go to a time of the recording."""
    page.evaluate(f"const t = document.getElementById('time'); t.value = {time}; t.dispatchEvent(new Event('input'))")
    page.wait_for_function(
        f"palpate.reels.every((r) => Math.abs(r.newest.head.time - {time}) < 0.002 && r.scene.moved.length)"
    )


def test_the_strain_on_the_page_equals_that_of_the_pictures(page, shown):
    page.select_option("#colour", "strain")
    at(page, 0.3)
    reel = shown.source.reels[0]
    surface = next(one for one in reel.last(0.3).values() if isinstance(one, Surface))
    expected = paint_vertices(COLOURS["strain"], reel.touched.bodies.mesh, surface)
    drawn = np.array(page.evaluate("Array.from(palpate.reels[0].scene.values)"))
    assert expected.max() > 0.05 and drawn == pytest.approx(expected, abs=2e-4)
    assert page.text_content("#top") == f"{100 * expected.max():.0f} %"
    assert page.text_content("#what") == "largest strain of the surface" and page.problems == []


def test_slip_is_shown_if_the_body_sends_it(page):
    page.select_option("#colour", "slip")
    at(page, 0.3)
    assert page.text_content("#what") == "displacement (this body sends no slip)"
    printed = page.evaluate("""async () => {
        const { painted } = await import("/scene.js"), { scene, newest } = palpate.reels[0];
        const slipped = Array.from(newest.nodes, (_, k) => k % 2);
        const { most, what } = painted([[scene, { ...newest, head: { ...newest.head, slipped } }]], "slip");
        return [most, what, Array.from(newest.nodes, (i) => scene.values[i]), slipped];
    }""")
    assert printed[:2] == [1, ""] and printed[2] == printed[3] and sum(printed[2]) > 3 and page.problems == []


OVERLAPS = """() => {
    const boxes = (selector) => [...document.querySelectorAll(selector)].map((e) => e.getBoundingClientRect());
    const meet = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
        && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
    const beyond = (a) => a.right > innerWidth + 1 || a.bottom > innerHeight + 1;
    const scenes = boxes(".scene"), cards = ["header", ".card", "#bar", "nav", "footer"];
    const over = cards.filter((s) => boxes(s).some((a) => beyond(a) || scenes.some((b) => meet(a, b))));
    return [...over, ...(scenes.every((b) => b.width > 300 && b.height > 200) ? [] : ["no room"])];
}"""


@pytest.mark.parametrize("size", [(1280, 800), (900, 700)])
def test_nothing_covers_the_picture(page, size):
    page.set_viewport_size({"width": size[0], "height": size[1]})
    assert page.evaluate(OVERLAPS) == []


def test_recordings_with_the_same_name_have_different_titles(page, shown):
    first, second = page.locator("h2").all_text_contents()
    assert first != second and second.startswith("other/touch.mcap")


DRAWN = """(endOn) => {
    const { scene, newest } = palpate.reels[0], gl = scene.gl, { tip, up, force } = newest.head;
    if (endOn) {
        scene.height = Math.asin(force[2] / Math.hypot(...force));
        scene.azimuth = Math.atan2(force[1], force[0]);
    }
    const pixels = (finger) => {
        scene.draw(finger ? [finger] : []);
        const all = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
        gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, all);
        return all;
    };
    const other = (a, b) => {
        const found = [];
        for (let k = 0; k < a.length; k += 4) {
            const off = [0, 1, 2].map((c) => Math.abs(a[k + c] - b[k + c]));
            if (Math.max(...off) > 5) found.push([Math.max(...off), a[k] + a[k + 1] + a[k + 2]]);
        }
        return found;
    };
    const without = pixels(undefined), ball = pixels({ tip, up, force: [0, 0, 0] }), both = pixels({ tip, up, force });
    return {
        ball: other(ball, without).map((p) => p[0]), arrow: other(both, ball).map((p) => p[1]),
        label: scene.labels[0].textContent,
    };
}"""


def test_the_fingertip_is_drawn_in_the_indentation_as_in_pictures(page, shown):
    at(page, 0.3)
    reel, head = shown.source.reels[0], page.evaluate("palpate.reels[0].newest.head")
    surface = next(one for one in reel.last(0.3).values() if isinstance(one, Surface))
    vertices = reel.touched.bodies.mesh.vertices
    expected = mean_drag(
        vertices, displace_vertices(surface, len(vertices)), np.array([head["foot"]]), np.array([head["up"]])
    )
    drawn = page.evaluate("({ foot, up }) => palpate.reels[0].scene.dragged(foot, up)", head)
    assert np.linalg.norm(expected) > 1e-4 and drawn == pytest.approx(expected[0], abs=1e-5)


def test_the_finger_is_visible_and_an_arrow_towards_the_viewer_is_shaded(page):
    page.evaluate("const t = document.getElementById('time'); t.value = 0.3; t.dispatchEvent(new Event('input'))")
    page.wait_for_function("palpate.reels.every((r) => Math.abs(r.newest.head.time - 0.3) < 0.002)")
    drawn = page.evaluate(DRAWN, False)
    assert np.mean(drawn["ball"]) > 50  # of 255, difference from the background
    drawn = page.evaluate(DRAWN, True)
    assert np.ptp(np.percentile(drawn["arrow"], [10, 90])) > 100  # of 765, from the lit side to the dark side
    force = page.evaluate("Math.hypot(...palpate.reels[0].newest.head.force)")
    assert drawn["label"] == f"{force:.2f} N" and page.problems == []
