"""A raw-HID device in the page, by WebHID, with an emulated `navigator.hid` (emulated_device.js): no real device was at
hand. The emulator stamps each command, so that the times of the guard are judged by the device's clock."""

import json
from pathlib import Path

import numpy as np
import pytest
from browser import NEEDED, opened
from test_folder import build
from three_js import served
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.drivers.guard import FALL, MISSED, SILENT, STALE
from palpate.drivers.hid import raw
from palpate.drivers.limits import LIMITS

pytest.importorskip("playwright.sync_api")
pytestmark = NEEDED
EMULATED = Path(__file__).with_name("emulated_device.js").read_text(encoding="utf-8")
BEGIN, DEEP = [0.0, 0.0, 0.116], [0.0, 0.0, 0.086]  # [m]
READY = "() => window.palpate && window.palpate.newest"
HOMED = f"palpate.newest?.tip && palpate.newest.sample === undefined && palpate.newest.tip[2] > {BEGIN[2] - 5e-3}"
COMMANDED = "async () => Math.hypot(...(await log()).log.at(-1).force) > 0.2"
FELT = "palpate.newest && palpate.newest.load > 0.3 && Math.hypot(...palpate.newest.force) > 0.3"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    out = tmp_path_factory.mktemp("web") / "site"
    done = build(out, "cartesian", "--set", "device.use=device.RawHid", "--body", "MassSpring")
    assert done.exit_code == 0, done.output
    return out


@pytest.fixture
def page(site):
    scripts = (f"window.emulated = {json.dumps(EMULATED)};", EMULATED)
    with served(site.parent) as address, opened(f"{address}/site/index.html", READY, scripts) as page:
        yield page


def attach(page, mode="well"):
    page.evaluate("([mode, place]) => device({ mode, place })", [mode, BEGIN])
    page.click("#device")


def press(page):
    """Press until the device exerts a force. A frame of the pointer's run, or one before the device is homed, does not
    count: the grip could be in the organ before its first place is known. On a busy machine a pause of 20 ms ends the
    force, which rises again in 0.5 s."""
    attach(page)
    page.wait_for_function("palpate.about && document.getElementById('device').getAttribute('aria-pressed') === 'true'")
    page.wait_for_function(HOMED)
    page.evaluate("(goal) => device({ goal })", DEEP)
    page.wait_for_function(FELT)
    page.evaluate("device({ hold: true })")
    page.wait_for_function(COMMANDED)


def log(page):
    """Times [s] and forces [N] of all commands, and what else the device knows."""
    found = page.evaluate("log()")
    assert all(one["good"] and one["version"] == raw.VERSION for one in found["log"])
    times = 1e-3 * np.array([one["now"] for one in found["log"]])
    return times, np.array([one["force"] for one in found["log"]]), found


def check_fade(page, allowed):
    """The force has fallen to zero `allowed` [s] after the last order, apart from pauses of the machine between
    commands; it fell without growing, and every later command is zero."""
    page.wait_for_function("async () => Math.hypot(...(await log()).log.at(-1).force) === 0")
    times, forces, found = log(page)
    begun = 1e-3 * found["since"]
    size = np.linalg.norm(forces, axis=1)
    last = np.flatnonzero(size > 0.0)[-1]
    late = times[last] - begun
    pause = np.diff(times[times > begun - 0.05]).max()
    assert late < allowed + 2.0 * pause + 1e-3
    falling = size[(times > begun + allowed - FALL) & (np.arange(len(size)) <= last + 1)]
    assert np.all(np.diff(falling) <= 1.5e-3)
    return times, forces


def test_the_device_is_the_finger_and_its_recording_is_replayed_bit_for_bit(page, tmp_path):
    assert page.is_visible("#device") and page.get_attribute("#device", "aria-pressed") == "false"
    press(page)
    _, forces, found = log(page)
    size = np.linalg.norm(forces, axis=1)
    assert 0.1 < size.max() <= LIMITS["rawhid"].command + 1e-3 and forces[np.argmax(size), 2] > 0.0
    assert {one["flags"] for one in found["log"]} == {raw.ASK_INFO, raw.ENABLE | raw.HOME}
    assert {one["watchdog"] for one in found["log"]} == {raw.WATCHDOG}
    with page.expect_download() as download:
        page.click("#download")
    download.value.save_as(tmp_path / "device.mcap")
    done = CliRunner().invoke(app, ["replay", str(tmp_path / "device.mcap"), "--check", "--json"])
    assert done.exit_code == 0 and json.loads(done.stdout)["ok"], done.output
    page.set_input_files("#file", tmp_path / "device.mcap")
    page.wait_for_function("/a device made it/.test(document.getElementById('status').textContent)")
    page.click("#device")
    page.wait_for_function("document.getElementById('device').getAttribute('aria-pressed') === 'false'")
    page.wait_for_function("palpate.newest && palpate.newest.sample !== undefined")
    _, forces, found = log(page)
    assert not forces[-3:].any() and found["closed"] == 1 and not found["opened"]
    assert page.problems == []


@pytest.mark.parametrize("mode", ["silent", "short", "damaged", "unhomed"])
def test_the_force_falls_to_zero_where_answers_are_missing_or_wrong(page, mode):
    press(page)
    page.evaluate("(mode) => device({ mode })", mode)
    check_fade(page, (SILENT if mode != "unhomed" else MISSED * raw.PATIENCE) + FALL)
    if mode != "unhomed":
        page.wait_for_function("/does not answer any more/.test(document.getElementById('status').textContent)")
    assert page.problems == []


def test_a_fault_of_the_device_ends_its_run_with_zero_commands(page):
    press(page)
    page.evaluate("device({ mode: 'fault' })")
    page.wait_for_function("/it reports a fault/.test(document.getElementById('status').textContent)")
    _, forces, found = log(page)
    assert not forces[-3:].any() and found["closed"] == 1


def test_a_hidden_page_lets_the_force_fall_to_zero_and_a_visible_one_continues(page):
    press(page)
    hide = """(hidden) => {
        if (hidden) device({ mode: "well" }); // stamps the time
        Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
        document.dispatchEvent(new Event("visibilitychange"));
    }"""
    page.evaluate(hide, True)
    check_fade(page, STALE + FALL)
    before = len(log(page)[0])
    page.evaluate(hide, False)
    page.wait_for_function(FELT)
    page.wait_for_function("async () => Math.hypot(...(await log()).log.at(-1).force) > 0.3")
    assert len(log(page)[0]) > before and page.problems == []


def test_an_unplugged_device_stops_its_run_and_reset_starts_one_of_the_pointer(page):
    press(page)
    page.evaluate("device({ unplug: true })")
    page.wait_for_function("/it is disconnected; reset/.test(document.getElementById('status').textContent)")
    assert page.get_attribute("#device", "aria-pressed") == "false"
    page.click("#reset")
    page.wait_for_function("palpate.newest && palpate.newest.sample !== undefined")
    assert page.problems == []


def test_a_device_without_valid_scales_is_refused(page):
    attach(page, "nan")
    page.wait_for_function("/scales of NaN/.test(document.getElementById('status').textContent)")
    _, forces, _ = log(page)
    assert not forces.any()


def test_a_folder_without_a_raw_hid_device_offers_none(tmp_path):
    assert build(tmp_path / "site", "kidney", "--body", "Rigid").exit_code == 0
    with opened((tmp_path / "site" / "index.html").as_uri(), READY) as page:
        assert page.is_hidden("#device") and page.problems == []
