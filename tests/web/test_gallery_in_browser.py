"""The touches of the gallery (docs/site/touches.py) in a real Chromium: each is built as for the site, and touched."""

import importlib.util
from pathlib import Path

import pytest
from browser import NEEDED, opened
from three_js import served

pytest.importorskip("playwright.sync_api")
pytestmark = NEEDED
FILE = Path(__file__).parents[2] / "docs" / "site" / "touches.py"
READY = "() => window.palpate && window.palpate.newest"
MOST = 3e6  # [bytes] that a page loads before the first touch
LOADED = """performance.getEntriesByType("resource").concat(performance.getEntriesByType("navigation"))
    .reduce((sum, { transferSize }) => sum + transferSize, 0)"""
FELT = ("cartesian", "falcon", "falcons", "fingertip", "kidney", "neighbours", "nodule", "organs", "palpate-two",
        "pinch", "pinch-liver", "sensors", "stack", "texture")  # fmt: skip
REFUSED = {
    "digit": "no node sends Surface",
    "fingertip-slide": "nodes that send DeviceState: found none",
    "indentation": "no node sends Surface",
    "remote": "runs in Python",
    "softness": "nodes that send DeviceState: found none",
}


@pytest.fixture
def touches(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("touches", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "HERE", tmp_path)
    return module


def press_and_lift(page):
    """Press a little above the middle of the picture, where each page shows an organ."""
    box = page.locator("#view").bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.45 * box["height"])
    page.mouse.down()
    page.wait_for_function("palpate.newest.load > 0")
    page.mouse.up()


@pytest.mark.parametrize("name", FELT)
def test_each_run_of_a_touch_has_a_force_and_the_first_loads_little(touches, name, tmp_path):
    touches.build_touches([name])
    with served(tmp_path) as address, opened(f"{address}/{name}/index.html", READY) as page:
        press_and_lift(page)
        assert 0.5e6 < page.evaluate(LOADED) < MOST
        scenes = page.evaluate("palpate.about.scenes")
        assert scenes[1:] == ([touches.EXACT] if name in touches.LIGHT else [])
        for scene in scenes[1:]:
            page.select_option("#scene", scene)
            page.wait_for_function("(name) => palpate.newest && palpate.about.scene === name", arg=scene)
            press_and_lift(page)
        assert page.problems == []


AHEAD = """() => {
    const { scene } = palpate, { eye, from, away } = scene.view(), painted = scene.paintAt.bind(scene);
    return new Promise((done) => {
        scene.paintAt = (camera, part, place, axis, length, ...rest) => {
            const head = place.map((x, i) => x + length * axis[i] - from[i]);
            if (part === scene.arrow) done(head.reduce((sum, x, i) => sum - x * eye[i], 0) / away);
            painted(camera, part, place, axis, length, ...rest);
        };
    });
}"""


def test_the_force_arrow_of_a_small_body_stays_away_from_the_viewer(touches, tmp_path):
    """Distance of its head over that of the middle of the fingertip, for a finger that presses its middle."""
    touches.build_touches(["fingertip"])
    with served(tmp_path) as address, opened(f"{address}/fingertip/index.html", READY) as page:
        page.mouse.move(330, 330)
        page.mouse.down()
        page.wait_for_function("palpate.newest.time > 1.5 && palpate.newest.load > 1")
        assert 0.3 < page.evaluate(AHEAD) < 1.0


@pytest.mark.parametrize("name", REFUSED)
def test_a_graph_without_a_touch_is_reported_with_the_reason(touches, name, tmp_path, capsys):
    touches.build_touches([name])
    assert f"{name}: no touch: " in (said := capsys.readouterr().out) and REFUSED[name] in said
    assert not (tmp_path / name).exists()


def test_all_shipped_graphs_are_named_here(touches, monkeypatch):
    monkeypatch.syspath_prepend(str(FILE.parents[1]))
    from gallery import runs

    assert sorted(runs()) == sorted((*FELT, *REFUSED))
