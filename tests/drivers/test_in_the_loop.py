"""Drivers in the kidney loop on the real clock, with emulators: only the line of the device differs."""

import time
from itertools import pairwise

import numpy as np
import pytest

from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.changed import change_plan
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

LATE = 0.3
"""Relative tolerance of a force balance on a busy machine: late ticks make the rendered body softer."""
PRESS = "device.path=[{hold: 0.1}, {to: [0, 0, 0.0935], time: 0.3}, {hold: 0.3}]"


OUTAGE = 20
"""Number of ticks left out between two polls after which the force of the device ramps up again."""


def until_undisturbed(steps, note):
    """A `watch` that ends a run when the device has made this number of steps without an outage and the run has printed
    the note; at the latest after 30 s."""
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
    """A touch with an emulated device, until it has made this number of steps in a row after a note; returns the
    outcome and the recorded messages by stream."""
    given = [f"device.use={use}", "device.port=emulator", "device.ramp=0.1", "controller.delay=3"]
    # With this drag of the grip and this delay the controller can render 571 N/m, more than the kidney has.
    given += ["device.damping=2.0", "controller.drag=2.0", *sets]
    file = tmp_path / "touch.mcap"
    launch = find(graph).but(overrides=given, duration=None, record=file, place="fused", clock="real")
    outcome = execute(launch, patience=30.0, watch=until_undisturbed(steps, note))
    messages: dict[str, list] = {}
    if file.is_file():
        recording = Recording(file)
        messages = {name: list(recording.messages(name)) for name in ("device", "finger", "controller")}
    return outcome, messages


def force(messages):
    return np.array([np.linalg.norm(m.force) for m in messages["controller"]])


def at_rest(messages, most):
    """Median force [N] and height [m] of the first rows (at most `most`) at which hand and force are at rest, 0.1 s
    without an outage before; if there are no rows of this kind, of the last ones. Later forces may be lower: if the
    hand went deeper in outages, or ticks are late, the controller withholds the energy that the force would return."""
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
    """A touch without faults: outcome, messages and file."""
    folder = tmp_path_factory.mktemp("good")
    return *touch(folder, PRESS), folder / "touch.mcap"


def test_a_falcon_touches_the_kidney(good):
    outcome, messages, _ = good
    assert outcome.result.ok, outcome.result.deaths
    assert messages["device"][-1].homed
    held, deep = at_rest(messages, 400)
    assert 0.5 < held < 3.5  # an arm of 500 N/m with a target 15 mm deep
    assert held == pytest.approx(500.0 * (deep - 0.0935), rel=LATE), "the force has reached the hand"


def test_a_replay_without_the_device_is_bit_equal(good):
    recording = Recording(good[2])
    report = verify(recording, change_plan(recording))
    assert report.ok and "device" not in report.nodes, report


def test_faults_of_the_device_cause_no_force_spike(tmp_path):
    days = "device.faults={dropouts: 0.02, garbled: 0.02, glitches: 0.01, noise: 0.2, latency: 0.001, seed: 4}"
    outcome, messages = touch(tmp_path, PRESS, days)
    assert outcome.result.ok, outcome.result.deaths
    assert force(messages).max() <= 9.0
    heights = np.array([m.position[2] for m in messages["finger"]])
    held, deep = at_rest(messages, 500)
    assert 0.5 < held < 3.5  # an arm of 500 N/m that wants to be 15 mm deep
    assert held == pytest.approx(500.0 * (deep - 0.0935), rel=LATE), "the force has reached the hand"
    assert np.all(np.isfinite(heights)) and heights.min() > 0.09 and heights.max() < 0.125


def test_unplugging_ends_the_run_with_one_line(tmp_path):
    outcome, _ = touch(tmp_path, PRESS, "device.faults={unplug: 1.0}", steps=20_000)
    (death,) = outcome.result.deaths
    assert death.node == "device" and death.text == "DeviceError: the Novint Falcon is gone. Plug it in again."


@pytest.mark.parametrize("use", ["device.Falcon", "device.Inverse3", "device.RawHid"])
def test_a_silent_device_ends_the_run_with_one_line(tmp_path, use):
    graph = "kidney" if use == "device.Falcon" else "cartesian"
    outcome, _ = touch(tmp_path, PRESS, "device.faults={silent: 1.0}", steps=20_000, use=use, graph=graph)
    (death,) = outcome.result.deaths
    assert not outcome.ok and death.node == "device"
    assert "does not answer any more: nothing came for 0.5 s" in death.text
    assert not any("rate:" in note for note in outcome.result.notes)


def test_a_silent_device_that_never_returns_is_an_error_at_the_end(tmp_path):
    waiting = ["device.faults={silent: 0.5}", "device.reconnect=true"]
    note = "the Novint Falcon does not answer any more: nothing came for 0.5 s. Check its power and connection."
    outcome, _ = touch(tmp_path, PRESS, *waiting, steps=100, note=f"{note} Waiting until it is back.")
    (death,) = outcome.result.deaths
    assert death.node == "device" and death.text == f"DeviceError: {note}"


def test_a_run_continues_after_reconnecting(tmp_path):
    days = "device.faults={unplug: 1.2, back: 1.8}"
    outcome, messages = touch(tmp_path, PRESS, days, "device.reconnect=true", note="The device is back.")
    assert outcome.result.ok, outcome.result.deaths
    others = ("Haptic", "MassSpring", "FalconKinematics", "optional inputs")  # of the outage, and of a busy machine
    assert [n for n in outcome.result.notes if "answers" not in n and not n.startswith(others)] == [
        "the Novint Falcon is gone. Plug it in again. Waiting until it is back.",
        "The device is back.",
    ]
    homed = [m.homed for m in messages["device"]]
    changes = [b for a, b in pairwise(homed) if a != b]
    assert changes[-2:] == [False, True]


def test_a_missing_device_ends_the_start_with_one_line(tmp_path):
    outcome, _ = touch(tmp_path, "device.port=''")
    (death,) = outcome.result.deaths
    assert death.where == "start" and death.text.startswith("DeviceError: ")


def test_hardware_on_the_simulated_clock_is_an_error():
    launch = find("kidney").but(overrides=["device.use=device.Falcon", "device.port=emulator"], duration=0.1)
    with pytest.raises(GraphError, match=r"(?s)'device': clock: found 'simulated'.*--clock real"):
        execute(launch)


@pytest.mark.parametrize("faults", ["{unplugged: 1}", "{dropouts: x}"])
def test_invalid_faults_are_errors(tmp_path, faults):
    with pytest.raises(GraphError, match="'device', setting 'faults'"):
        touch(tmp_path, f"device.faults={faults}")


def test_a_process_for_each_node_computes_the_bytes_of_one_process(tmp_path):
    """On the real clock two runs of a device differ, so one process recomputes each message from those that it used."""
    given = ["device.port=emulator", "device.ramp=0.1", PRESS]
    file = tmp_path / "touch.mcap"
    launch = find("falcon").but(overrides=given, duration=1.0, record=file, place="apart", clock="real")
    outcome = execute(launch, patience=30.0)
    assert outcome.result.ok, outcome.result.deaths
    recording = Recording(file)
    report = verify(recording, plan_of(recording))
    assert report.first is None
    checked = {name: node.checked for name, node in report.nodes.items() if name != "device"}
    assert min(checked.values()) > 50, checked
    assert max(message.force[2] for message in recording.messages("controller")) > 0.1


@pytest.mark.parametrize("use", ["device.RawHid", pytest.param("device.Inverse3", marks=pytest.mark.long)])
def test_a_device_that_takes_a_force_touches_the_kidney(tmp_path, use):
    outcome, messages = touch(tmp_path, PRESS, use=use, graph="cartesian")
    assert outcome.result.ok, outcome.result.deaths
    held, deep = at_rest(messages, 300)
    assert 0.5 < held < 3.5  # an arm of 500 N/m that wants to be 15 mm deep
    assert held == pytest.approx(500.0 * (deep - 0.0935), rel=LATE), "the force has reached the hand"
