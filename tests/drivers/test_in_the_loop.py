"""Drivers in the whole kidney loop on the real clock, against emulators: only the line of the device is another."""

import time
from itertools import pairwise

import numpy as np
import pytest

from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.changed import changed
from palpate.records.reader import Recording
from palpate.records.verify import verify

LATE = 0.3
"""Relative tolerance of a balance that is read while the machine may be busy: late ticks soften what is shown."""
PRESS = "device.path=[{hold: 0.1}, {to: [0, 0, 0.0935], time: 0.3}, {hold: 0.3}]"


OUTAGE = 20
"""Ticks left out between two looks from which on the device's force has to come in anew."""


def until_it_went_on(steps, note):
    """A `watch` that ends a run when the device has made so many steps without an outage, and the run has told this;
    after half a minute, the longest for a machine without a pause, anyway."""
    begun, late, left, looked = 0, 0, 30.0, time.monotonic()

    def watch(running):
        nonlocal begun, late, left, looked
        moment = time.monotonic()
        device = running.result.health.get("device", {"steps": 0, "late": 0})
        left, looked = (
            left - min(moment - looked, 0.2 if device["steps"] else 0.0),
            moment,
        )  # kernels may have to compile
        printed = not note or note in running.result.notes
        if not printed or device["late"] - late > OUTAGE or not device["steps"]:
            begun = device["steps"]
        late = device["late"]
        if left < 0.0 or device["steps"] - begun >= steps:
            running.stop()

    return watch


def touch(tmp_path, *sets, steps=1500, note="", use="device.Falcon", graph="kidney"):
    """A touch with an emulated device, until it has made so many steps in a row after a note; the outcome and the
    recording's messages by stream."""
    given = [f"device.use={use}", "device.port=emulator", "device.ramp=0.1", "controller.delay=3"]
    # A grip with this drag lets the controller show 571 N/m at this delay, more than the kidney has.
    given += ["device.damping=2.0", "controller.drag=2.0", *sets]
    file = tmp_path / "touch.mcap"
    launch = find(graph).but(overrides=given, duration=None, record=file, place="fused", clock="real")
    outcome = execute(launch, patience=30.0, watch=until_it_went_on(steps, note))
    messages: dict[str, list] = {}
    if file.is_file():
        recording = Recording(file)
        messages = {name: list(recording.messages(name)) for name in ("device", "finger", "controller")}
    return outcome, messages


def force(messages):
    return np.array([np.linalg.norm(m.force) for m in messages["controller"]])


def at_rest(messages, most):
    """Median force [N] and height [m] at the first rows, so many at most, at which hand and force rest after a tenth of
    a second without an outage. What comes later may be less: where the hand went deeper in outages, or ticks are late,
    the controller withholds what the force would give back of that, in the end all of it. Without such rows, of the
    last ones."""
    shown = force(messages)
    heights = np.array([m.position[2] for m in messages["finger"]])[-len(shown) :]
    ticks = np.array([m.tick for m in messages["device"]])[-len(shown) :]
    missed = ticks - np.arange(len(ticks))
    rows = np.arange(150, len(ticks))
    calm = missed[rows] - missed[rows - 150] < OUTAGE // 2
    rests = np.abs(heights[rows] - heights[rows - 50]) < 1e-4
    holds = np.abs(shown[rows] - shown[rows - 50]) < 0.05 * shown[rows]
    found = rows[calm & rests & holds][:most]
    rows = found if len(found) > 20 else rows[-most:]
    return np.median(shown[rows]), np.median(heights[rows])


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A touch on a good day: outcome, messages and file."""
    folder = tmp_path_factory.mktemp("good")
    return *touch(folder, PRESS), folder / "touch.mcap"


def test_a_falcon_touches_the_kidney(good):
    outcome, messages, _ = good
    assert outcome.result.ok, outcome.result.deaths
    assert messages["device"][-1].homed
    held, deep = at_rest(messages, 400)
    assert 0.5 < held < 3.5  # an arm of 500 N/m that wants to be 15 mm deep
    assert held == pytest.approx(500.0 * (deep - 0.0935), rel=LATE), "the force has reached the hand"


def test_the_touch_is_computed_again_bit_for_bit_without_the_device(good):
    recording = Recording(good[2])
    report = verify(recording, changed(recording))
    assert report.ok and "device" not in report.nodes, report


def test_bad_days_end_in_no_wild_force(tmp_path):
    days = "device.faults={dropouts: 0.02, garbled: 0.02, glitches: 0.01, noise: 0.2, latency: 0.001, seed: 4}"
    outcome, messages = touch(tmp_path, PRESS, days)
    assert outcome.result.ok, outcome.result.deaths
    assert force(messages).max() <= 9.0
    heights = np.array([m.position[2] for m in messages["finger"]])
    held, deep = at_rest(messages, 500)
    assert 0.5 < held < 3.5  # an arm of 500 N/m that wants to be 15 mm deep
    assert held == pytest.approx(500.0 * (deep - 0.0935), rel=LATE), "the force has reached the hand"
    assert np.all(np.isfinite(heights)) and heights.min() > 0.09 and heights.max() < 0.125


def test_pulling_the_plug_ends_the_run_with_one_line(tmp_path):
    outcome, _ = touch(tmp_path, PRESS, "device.faults={unplug: 1.0}", steps=20_000)
    (death,) = outcome.result.deaths
    assert death.node == "device" and death.text == "DeviceError: the Novint Falcon is gone. Plug it in again."


@pytest.mark.parametrize("use", ["device.Falcon", "device.Inverse3", "device.RawHid"])
def test_a_device_that_falls_silent_ends_the_run_with_one_line_and_no_advice(tmp_path, use):
    graph = "kidney" if use == "device.Falcon" else "cartesian"
    outcome, _ = touch(tmp_path, PRESS, "device.faults={silent: 1.0}", steps=20_000, use=use, graph=graph)
    (death,) = outcome.result.deaths
    assert not outcome.ok and death.node == "device"
    assert "does not answer any more: nothing came for 0.5 s" in death.text
    assert not any("rate:" in note for note in outcome.result.notes)


def test_a_silent_device_that_is_waited_for_in_vain_is_an_error_at_the_end(tmp_path):
    waiting = ["device.faults={silent: 0.5}", "device.reconnect=true"]
    note = "the Novint Falcon does not answer any more: nothing came for 0.5 s. Check its power and connection."
    outcome, _ = touch(tmp_path, PRESS, *waiting, steps=100, note=f"{note} Waiting until it is back.")
    (death,) = outcome.result.deaths
    assert death.node == "device" and death.text == f"DeviceError: {note}"


def test_a_run_that_reconnects_goes_on(tmp_path):
    days = "device.faults={unplug: 1.2, back: 1.8}"
    outcome, messages = touch(tmp_path, PRESS, days, "device.reconnect=true", note="The device is back.")
    assert outcome.result.ok, outcome.result.deaths
    assert [n for n in outcome.result.notes if "answers" not in n and not n.startswith("Haptic")] == [
        "the Novint Falcon is gone. Plug it in again. Waiting until it is back.",
        "The device is back.",
    ]
    homed = [m.homed for m in messages["device"]]
    changes = [b for a, b in pairwise(homed) if a != b]
    assert changes[-2:] == [False, True]


def test_a_device_that_is_not_there_ends_the_start_with_one_line(tmp_path):
    outcome, _ = touch(tmp_path, "device.port=''")
    (death,) = outcome.result.deaths
    assert death.where == "start" and death.text.startswith("DeviceError: ")


def test_hardware_does_not_run_on_the_simulated_clock():
    launch = find("kidney").but(overrides=["device.use=device.Falcon", "device.port=emulator"], duration=0.1)
    with pytest.raises(GraphError, match=r"(?s)'device': clock: found 'simulated'.*--clock real"):
        execute(launch)


@pytest.mark.parametrize("faults", ["{unplugged: 1}", "{dropouts: x}"])
def test_faults_that_are_none_are_told(tmp_path, faults):
    with pytest.raises(GraphError, match="'device', setting 'faults'"):
        touch(tmp_path, f"device.faults={faults}")


@pytest.mark.parametrize("use", ["device.RawHid", pytest.param("device.Inverse3", marks=pytest.mark.long)])
def test_a_device_that_takes_a_force_touches_the_kidney(tmp_path, use):
    outcome, messages = touch(tmp_path, PRESS, use=use, graph="cartesian")
    assert outcome.result.ok, outcome.result.deaths
    held, deep = at_rest(messages, 300)
    assert 0.5 < held < 3.5  # an arm of 500 N/m that wants to be 15 mm deep
    assert held == pytest.approx(500.0 * (deep - 0.0935), rel=LATE), "the force has reached the hand"
