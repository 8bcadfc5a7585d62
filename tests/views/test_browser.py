"""The page in a real Chromium: it loads, the organ deforms under the mouse, switches work, no console errors."""

import pytest
from browser import NEEDED, opened

pytest.importorskip("websockets")
pytest.importorskip("playwright.sync_api")

from test_page import Server

pytestmark = NEEDED


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    made = Server(tmp_path_factory.mktemp("touch"))
    yield made
    made.close()


@pytest.fixture
def page(server):
    with opened(server.url(), "window.palpate && palpate.newest") as page:
        yield page


def wait_for_restart(page):
    """The old run continues until it has ended: for a while the page still shows its frames and `running`."""
    page.wait_for_function("document.getElementById('status').textContent == 'starting'")
    page.wait_for_function("document.getElementById('status').textContent == 'running' && palpate.newest")


def test_the_mouse_moves_the_finger(page):
    page.mouse.move(500, 330)
    page.mouse.down()
    page.wait_for_function("palpate.newest.load > 0.3 && palpate.scene.moved.length > 0")
    page.wait_for_function("Number(document.getElementById('force').value) > 0.3")
    near = """() => {
        const box = document.getElementById('view').getBoundingClientRect();
        const hit = palpate.scene.pick(2 * (500 - box.left) / box.width - 1, 1 - 2 * (330 - box.top) / box.height);
        return Math.hypot(...hit.place.map((x, i) => x - palpate.newest.foot[i]));
    }"""
    page.wait_for_function(f"({near})() < 0.008")
    shallow = page.evaluate("palpate.newest.load")
    for _ in range(6):
        page.mouse.wheel(0, -100)
    page.wait_for_function(f"palpate.newest.load > {1.1 * shallow}")
    page.mouse.up()
    page.wait_for_function("palpate.newest.load == 0")
    assert page.problems == []


def test_the_space_key_presses_and_switches_change_the_body(page):
    page.focus("#view")
    page.keyboard.down(" ")
    page.wait_for_function("palpate.newest.load > 0.1")
    page.keyboard.up(" ")
    page.select_option("#body", "deformation.ReducedFE")
    wait_for_restart(page)
    assert page.input_value("#body") == "deformation.ReducedFE"
    page.click("#pause")
    assert page.get_attribute("#pause", "aria-pressed") == "true"
    page.click("#keep")
    page.wait_for_selector("#keep[aria-pressed=false]")
    assert page.problems == []


PAD = """(axes, pressed) => {
    navigator.getGamepads = () => [{ axes, buttons: pressed.map((on) => ({ pressed: on, value: Number(on) })) }];
}"""


def test_a_gamepad_aims_and_presses(page):
    page.evaluate(f"({PAD})([0, 0, 0, 0], [])")
    page.mouse.move(500, 330)
    page.evaluate(f"({PAD})([0.5, 0, 0, 0], [true])")
    page.wait_for_function("palpate.newest.load > 0.1")
    turned = page.evaluate("palpate.scene.azimuth")
    page.evaluate(f"({PAD})([0, 0, 1, 0], [false])")
    page.wait_for_function(f"palpate.newest.load == 0 && palpate.scene.azimuth != {turned}")
    page.evaluate(f"({PAD})([0, 0, 0, 0], [])")
    assert page.problems == []


def test_the_contact_patch_can_be_the_colour(page):
    page.select_option("#colour", "load")
    page.mouse.move(500, 330)
    page.mouse.down()
    page.wait_for_function("palpate.newest.patch.length > 3")
    page.wait_for_function("document.getElementById('what').textContent == 'load on a vertex'")
    loaded = "palpate.newest.loads.filter((v) => v > 0).length"
    page.wait_for_function(f"palpate.scene.values.filter((v) => v > 0).length == {loaded} && {loaded} > 3")
    page.mouse.up()
    page.wait_for_function("palpate.newest.load == 0")
    page.select_option("#colour", "displacement")
    page.mouse.move(510, 330)
    assert page.problems == []


def test_an_effect_can_be_switched_off_during_the_run(page):
    box = "input[data-effect=friction]"
    page.wait_for_selector(box)
    assert page.is_checked(box) and page.locator("#effects input").count() == 3
    page.uncheck(box)
    wait_for_restart(page)
    page.wait_for_function("palpate.newest && palpate.newest.stick === undefined")
    assert not page.is_checked(box)
    page.check(box)
    wait_for_restart(page)
    page.wait_for_function("palpate.newest && palpate.newest.stick !== undefined")
    assert page.problems == []


def test_numbers_of_any_width_do_not_move_the_toolbar(page):
    page.set_viewport_size({"width": 1280, "height": 800})
    boxes = []
    for depth in (8, 8.5, 20):
        page.evaluate(
            f"const p = document.getElementById('press'); p.value = {depth}; p.dispatchEvent(new Event('input'))"
        )
        boxes.append([page.locator(name).bounding_box() for name in ("nav", "#pause", "#view")])
    assert boxes[0] == boxes[1] == boxes[2] and boxes[0][0]["height"] < 60


@pytest.mark.parametrize("width, height", [(1280, 800), (390, 844)])
def test_the_pins_leave_room_for_the_other_charts(page, width, height):
    page.set_viewport_size({"width": width, "height": height})
    without = page.locator("#forces").bounding_box()["width"]
    page.evaluate(
        "const pins = document.getElementById('pins'); pins.style.setProperty('display', 'block', 'important')"
    )
    card, forces, pins = (page.locator(name).bounding_box() for name in ("#numbers", "#forces", "#pins"))
    assert forces["width"] == without and pins["width"] > 0.8 * card["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width

    drawn = """async () => {
        const { bars } = await import("/charts.js"), pins = document.getElementById("pins"), tops = [], rooms = [];
        const kind = CanvasRenderingContext2D.prototype, { fillRect, fillText } = kind;
        kind.fillRect = function (x, y, ...size) { tops.push(y); fillRect.call(this, x, y, ...size); };
        kind.fillText = function (text, ...at) {
            rooms.push(this.measureText(text).width); fillText.call(this, text, ...at);
        };
        for (const rows of [1, 6]) bars(pins, Array.from({ length: rows }, (_, r) => [0, 0.01234, 1e-3 * r]));
        Object.assign(kind, { fillRect, fillText });
        return { top: Math.min(...tops), room: pins.clientWidth - Math.max(...rooms) };
    }"""
    found = page.evaluate(drawn)
    assert found["top"] > 13 and found["room"] > 0  # below the caption, which has its baseline at 10 and fits


def move_until_answered(page):
    """A frame that answers a sample of the pointer can be lost where the old run ends: move again, as a hand does."""
    for x in range(501, 600):
        page.mouse.move(x, 330)
        page.wait_for_timeout(500)
        if page.evaluate("palpate.delays.length > 0"):
            return
    raise AssertionError("no sample of the pointer was answered")


def test_the_pointer_delay_ignores_pauses_of_the_page(page):
    shift = """(shifts) => {
        const real = performance.now.bind(performance);
        performance.now = () => real() + (shifts() ? 1e6 : 0);
        let last = palpate.latency;
        palpate.delays = [];
        const set = (to) => { last = to; if (to !== undefined) palpate.delays.push(to); };
        Object.defineProperty(palpate, "latency", { get: () => last, set });
    }"""
    page.mouse.move(500, 330)
    page.wait_for_function("palpate.latency > 0")
    page.evaluate(f"({shift})(() => palpate.leap && Boolean(palpate.newest))")
    page.evaluate("palpate.leap = true; palpate.delays = []")
    page.click("#reset")  # the clock jumps at the first frame
    wait_for_restart(page)
    move_until_answered(page)
    assert page.evaluate("Math.max(...palpate.delays)") < 1e6
    page.evaluate("palpate.delays = []; palpate.leap = false")  # and jumps back
    page.click("#pause")
    page.evaluate("palpate.leap = true")
    page.click("#pause")
    page.wait_for_timeout(300)
    move_until_answered(page)
    assert page.evaluate("Math.max(...palpate.delays)") < 1e6
