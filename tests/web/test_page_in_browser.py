"""The page of `palpate build web` in a real Chromium, opened as a file: touch, switches, recording, damage."""

import json
import re
import shutil
from pathlib import Path

import pytest
from browser import NEEDED, opened
from test_folder import build
from three_js import served, unpack_three
from typer.testing import CliRunner

from palpate.cli.__main__ import app

pytest.importorskip("playwright.sync_api")
pytestmark = NEEDED
EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "web" / "three.html"
READY = "() => window.palpate && window.palpate.newest"
MIDDLE = (500, 330)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    out = tmp_path_factory.mktemp("web") / "site"
    done = build(out, "kidney", "--body", "MassSpring", "--body", "Rigid")
    assert done.exit_code == 0, done.output
    return out


@pytest.fixture
def page(site):
    with opened((site / "index.html").as_uri(), READY) as page:
        yield page


def press(page):
    page.mouse.move(*MIDDLE)
    page.mouse.down()
    page.wait_for_function("palpate.newest.load > 0.3 && palpate.scene.moved.length > 0")


def test_the_mouse_presses_and_the_recording_is_replayed_bit_for_bit(page, tmp_path):
    press(page)
    assert page.inner_text("#stick") in ("sticks", "slips")
    page.mouse.up()
    page.wait_for_function("palpate.newest.load == 0")
    with page.expect_download() as download:
        page.click("#download")
    download.value.save_as(tmp_path / "page.mcap")
    assert download.value.suggested_filename == "kidney.mcap"
    page.wait_for_function("document.getElementById('status').textContent == 'running'")
    done = CliRunner().invoke(app, ["replay", str(tmp_path / "page.mcap"), "--check", "--json"])
    assert done.exit_code == 0 and json.loads(done.stdout)["ok"], done.output
    assert page.problems == []


def test_switches_change_body_and_effects_and_start_again(page):
    press(page)
    page.mouse.up()
    page.select_option("#body", "deformation.Rigid")
    page.wait_for_function(
        "palpate.newest && palpate.newest.time < 0.5 && document.getElementById('body').value == 'deformation.Rigid'"
    )
    press_rigid = "palpate.newest.load > 0.3 && palpate.newest.squeeze > 0"
    page.mouse.move(*MIDDLE)
    page.mouse.down()
    page.wait_for_function(press_rigid)
    page.mouse.up()
    page.click("#effects input[data-effect=friction]")
    page.wait_for_function("palpate.newest && palpate.newest.stick === undefined")
    page.click("#reset")
    page.wait_for_function("palpate.newest && palpate.newest.time < 0.5")
    assert page.problems == []


def test_two_switches_at_once_both_take_effect(page):
    page.evaluate("""() => {
        const body = document.getElementById("body");
        const friction = document.querySelector("#effects input[data-effect=friction]");
        body.value = "deformation.Rigid"; body.dispatchEvent(new Event("change"));
        friction.checked = false; friction.dispatchEvent(new Event("change"));
    }""")
    page.wait_for_function("palpate.newest && palpate.newest.time > 0.05 && palpate.newest.stick === undefined")
    assert page.input_value("#body") == "deformation.Rigid"
    assert page.problems == []


def test_the_slider_orders_the_bodies_by_their_error_and_starts_them(page):
    page.evaluate("document.getElementById('more').open = true")
    page.wait_for_function("/^MassSpring: error .* here [1-9]/.test(document.getElementById('priced').textContent)")
    errors = page.evaluate("palpate.about.figures.bodies")
    assert errors["deformation.Rigid"]["error"] > errors["deformation.MassSpring"]["error"] > 0.0
    assert page.input_value("#exact") == "1"
    page.focus("#exact")
    page.keyboard.press("ArrowLeft")
    page.wait_for_function("document.getElementById('body').value == 'deformation.Rigid' && palpate.newest")
    page.wait_for_function("/^Rigid: error .* here [1-9]/.test(document.getElementById('priced').textContent)")
    assert page.problems == []


@pytest.mark.parametrize("case", ["stiff", "stab"])
def test_a_hard_case_runs_in_the_page_and_reports_its_outcome(page, case):
    page.evaluate("document.getElementById('more').open = true")
    page.select_option("#case", case)
    page.click("#hard")
    page.wait_for_function("/after the lift/.test(document.getElementById('outcome').textContent)")
    found = re.search(r"all numbers finite, hand at most ([\d.]+) N \(limit 9 N\), contact at most ([\d.]+) N, 0.00 N",
                      page.inner_text("#outcome"))  # fmt: skip
    assert 0.3 < float(found[1]) <= 9.0 and float(found[2]) > 1.0
    page.click("#reset")
    page.wait_for_function("palpate.newest && palpate.newest.time < 0.5 && palpate.about.case === null")
    assert page.problems == []


def test_the_page_runs_the_touch_of_its_recording_again(page, tmp_path):
    press(page)
    page.wait_for_timeout(1000)  # a touch that slow frames show too
    page.mouse.up()
    page.wait_for_function("palpate.newest.load == 0")
    with page.expect_download() as download:
        page.click("#download")
    file = tmp_path / "touch.mcap"
    download.value.save_as(file)
    page.select_option("#body", "deformation.Rigid")
    page.wait_for_function("palpate.newest && document.getElementById('body').value == 'deformation.Rigid'")
    page.set_input_files("#file", file)
    page.wait_for_function("palpate.newest && palpate.newest.load > 0.3")
    assert page.inner_text("#status") == "replaying touch.mcap"
    page.wait_for_function("/^replayed/.test(document.getElementById('status').textContent)")
    assert re.fullmatch(r"replayed: all \d+ compared messages equal", page.inner_text("#status"))
    assert page.input_value("#body") == "deformation.MassSpring"
    file.write_bytes(file.read_bytes()[:5000])
    page.set_input_files("#file", file)
    page.wait_for_function("/^touch.mcap: the file is damaged/.test(document.getElementById('status').textContent)")
    assert page.problems == []


def test_scenes_and_organs_are_switched_in_the_page(tmp_path):
    scenes = ("--scene", "kidney", "--scene", "frictionless")
    assert build(tmp_path / "site", "kidney", "--body", "MassSpring", *scenes).exit_code == 0
    with opened((tmp_path / "site" / "index.html").as_uri(), READY) as page:
        press(page)
        assert page.inner_text("#stick") in ("sticks", "slips") and page.is_hidden("#organ")
        page.mouse.up()
        page.select_option("#scene", "frictionless")
        page.wait_for_function("palpate.newest && palpate.newest.stick === undefined")
        assert page.problems == []


def test_nodes_that_do_not_run_are_listed_with_the_reason(tmp_path):
    assert build(tmp_path / "site", "nodule", "--body", "MassSpring").exit_code == 0
    with opened((tmp_path / "site" / "index.html").as_uri(), READY) as page:
        page.evaluate("document.getElementById('more').open = true")
        assert page.is_hidden("#exactness") and page.is_visible("#cases")  # a slider needs two bodies
        listed = page.inner_text("#runs")
        assert re.search(r"band\s+Probabilistic runs in Python", listed)
        assert re.search(r"display\s+PinArray runs in Python", listed)
        press(page)
        assert page.problems == []


def test_a_hidden_page_lifts_the_finger_and_stops_its_clock(page):
    press(page)
    hide = """(hidden) => {
        Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
        document.dispatchEvent(new Event("visibilitychange"));
    }"""
    page.evaluate(hide, True)
    page.wait_for_function("palpate.newest.load == 0")
    wait = "new Promise((done) => setTimeout(done, 700))"
    stands = f"() => {{ const t = palpate.newest.time; return {wait}.then(() => palpate.newest.time === t); }}"
    page.wait_for_function(stands)
    before = page.evaluate("palpate.newest.time")
    page.evaluate(hide, False)
    page.wait_for_function(f"palpate.newest.time > {before} + 0.2")
    assert page.evaluate("palpate.newest.late") < 100  # the time in which it was hidden does not count


def test_a_server_and_a_program_in_a_page_work_without_other_addresses(site):
    with served(site.parent) as address:
        (site.parent / "program.html").write_text(
            '<script type="module">import { load } from "./site/palpate.mjs"; const touch = await load("site"); '
            "const [x, y, z] = touch.about.pointers[0].begin; touch.point([x, y, z - 0.03]); touch.step(0.8); "
            "window.palpate = { newest: touch.contact() };</script>"
        )
        with opened(f"{address}/program.html", READY) as page:
            assert page.evaluate("palpate.newest.load") > 0.2 and page.problems == [
                "Failed to load resource: the server responded with a status of 404 (File not found)"
            ]
        with opened(f"{address}/site/index.html", READY) as page:
            asked = page.evaluate("performance.getEntriesByType('resource').map(({ name }) => name)")
            assert all(one.startswith((address, "blob:", "data:")) for one in asked) and page.problems == []


def test_the_example_in_three_js_is_touched_with_the_mouse(site):
    text = EXAMPLE.read_text()
    assert len(text.splitlines()) <= 100
    shutil.copy(EXAMPLE, site.parent)
    unpack_three(site.parent)
    with served(site.parent) as address, opened(f"{address}/three.html", READY) as page:
        page.mouse.move(*MIDDLE)
        page.mouse.down()
        page.mouse.move(MIDDLE[0] + 1, MIDDLE[1])
        page.wait_for_function("palpate.newest.load > 0.3 && palpate.touch.surface().nodes.length > 3")
        assert page.locator("button").is_hidden()  # no headset here
        assert page.problems == []


def test_a_damaged_folder_is_refused(site, tmp_path):
    shutil.copytree(site, tmp_path / "site")
    file = max((tmp_path / "site" / "data").iterdir(), key=lambda file: file.stat().st_size)
    text = file.read_text()
    file.write_text(text[:-400] + ("A" if text[-400] != "A" else "B") + text[-399:])
    stopped = "() => document.getElementById('status').textContent.startsWith('stopped')"
    with opened((tmp_path / "site" / "index.html").as_uri(), stopped) as page:
        assert file.stem in page.inner_text("#status") and "damaged" in page.inner_text("#status")
        assert not page.evaluate("Boolean(palpate.newest)")
