"""The page in Chromium with a constant source: its texts and controls, and that it fits into the window."""

import numpy as np
import pytest
from browser import NEEDED, opened

pytest.importorskip("websockets")
pytest.importorskip("playwright.sync_api")

from palpate.physics.geometry.mesh import plane
from palpate.views.page.feed import FrameSource, pack_message, surface_frame
from palpate.views.page.server import PageServer

pytestmark = NEEDED
FINGER = {"time": 1.25, "normal": [0, 0, 1], "foot": [0, 0, 0], "load": 2.6, "depth": 8e-3, "squeeze": 1e-3,
          "tip": [0, 0, -8e-3], "up": [0, 0, 1], "force": [0, 0.8, 2.7], "stick": True, "energy": 1e-3,
          "t": [1.0, 1.25], "f": [0.0, 2.6], "s": [0.0, 8e-3]}  # fmt: skip


class Still(FrameSource):
    """Two fingers that press a plane, as `palpate touch pinch` has them."""

    status = "running"

    def __init__(self, **more):
        super().__init__()
        self.mesh = surface_frame(
            plane(0.1, 300),
            {"body": "deformation.MassSpring", "thickness": 4e-3, "begins": [[0, 0, 0.02], [0, 0, -0.02]],
             "fingers": ["contact-thumb", "contact-index"], "recording": "runs/touch/pinch-1.mcap",
             "bodies": ["deformation.MassSpring"], "effects": {"friction": True, "relaxation": True, "band": False}},
        )  # fmt: skip
        head = {"kind": "frame", "late": 0, **FINGER, "others": [FINGER], **more}
        nodes, moved = np.arange(5, dtype="<u4"), np.full(15, -2e-3, "<f4")
        self.frame = pack_message(head, nodes, moved, np.zeros(0, "<f4"))


@pytest.fixture(scope="module")
def address():
    server = PageServer(Still(patch=[1, 2], loads=[0.1, 0.2]))
    yield server.address
    server.close()


BEYOND = """() => [...document.querySelectorAll(".card, .card *, nav, nav *")].filter((e) => {
    const box = e.getBoundingClientRect(), card = e.closest(".card, nav").getBoundingClientRect();
    return box.width && (box.right > card.right + 1 || box.bottom > card.bottom + 1 || box.right > innerWidth + 1);
}).map((e) => e.outerHTML)"""


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_the_page_fits_its_panels_and_the_toolbar_is_one_line(address, size):
    with opened(address, "window.palpate && palpate.newest") as page:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.select_option("#colour", "strain")
        page.wait_for_function("document.getElementById('what').textContent == 'largest strain of the surface'")
        assert page.evaluate(BEYOND) == []
        if size[0] > 1000:
            assert page.locator("nav").bounding_box()["height"] < 60
        assert page.problems == []


def test_each_force_is_named_and_only_available_colours_are_offered(address):
    with opened(address, "window.palpate && palpate.newest") as page:
        page.wait_for_function("document.getElementById('load').textContent == '2.60 · 2.60'")
        assert page.text_content("#force") == "2.82 · 2.82"
        page.wait_for_function("![...document.getElementById('colour').options].find((o) => o.value == 'load').hidden")
        offered = page.evaluate(
            "[...document.getElementById('colour').options].filter((o) => !o.hidden).map((o) => o.value)"
        )
        assert offered == ["displacement", "load", "strain"]


def test_the_page_shows_a_pause_and_names_its_screenshot(address):
    with opened(address, "window.palpate && palpate.newest") as page:
        page.click("#pause")
        assert page.text_content("#pause") == "resume"
        assert page.text_content("#status") == "paused: the run continues"
        page.click("#pause")
        assert (page.text_content("#pause"), page.text_content("#status")) == ("pause", "running")
        below = page.evaluate("document.getElementById('view').height")
        with page.expect_download() as download:
            page.click("#shot")
        assert download.value.suggested_filename == "pinch-1-1.250s.png"
        data = download.value.path().read_bytes()
        assert int.from_bytes(data[20:24], "big") > below + 40  # the lines and the colour bar below the picture


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_checkboxes_fit_a_finger_and_one_usage_line_is_shown(address, size):
    with opened(address, "window.palpate && palpate.newest") as page:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        boxes = page.evaluate(
            "[...document.querySelectorAll('input[type=checkbox]')].map((e) => e.getBoundingClientRect())"
            ".map((b) => [b.width, b.height])"
        )
        assert len(boxes) == 3 and min(min(box) for box in boxes) >= 24
        shown = page.evaluate(
            "[...document.querySelectorAll('footer .mouse, footer .phone')]"
            ".filter((e) => e.getBoundingClientRect().height).map((e) => e.className)"
        )
        assert shown == (["mouse"] if size[0] > 700 else ["phone"])
        assert page.locator("footer").bounding_box()["y"] < size[1] - 10


@pytest.mark.parametrize(
    ("low", "high", "count", "ticks"),
    [(0, 2.6, 3, [0, 1, 2]), (0, 8.3, 3, [0, 5]), (-6, 0, 4, [-6, -4, -2, 0]), (-0.2, 0.9, 3, [0, 0.5])],
)
def test_ticks_of_histories_are_round(address, low, high, count, ticks):
    with opened(address, "window.palpate && palpate.newest") as page:
        assert page.evaluate(f"import('/charts.js').then((m) => m.round({low}, {high}, {count}))") == ticks
