"""Limits of the devices compared with their source; the largest commands that a driver sends; torque in a run."""

import math
import re
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from pytest import approx

from palpate.drivers import guard
from palpate.drivers.falcon import frames
from palpate.drivers.falcon.driver import FalconDriver
from palpate.drivers.guard import DeviceSample, Guard
from palpate.drivers.haply.inverse3 import Inverse3Driver
from palpate.drivers.hid.raw import WATCHDOG, RawHidDriver
from palpate.drivers.limits import LIMITS
from palpate.drivers.sensors.netft import NetFTDriver
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

FULL_SCALE, PER_TORQUE = 4096, 10_000.0
"""Largest motor word of a Falcon, chosen by this project; words per N m, from libnifalcon
(src/kinematic/FalconKinematicStamper.cpp, getForces: "torque *= 10000.0"), which has no limit there."""
ANYWHERE = ((-math.inf,) * 3, (math.inf,) * 3)
FALCON_BOX = ((-0.09, -0.09, 0.06), (0.09, 0.09, 0.185))
ROWS = {
    # command, power [W], speed [m/s], box [m], delay, ramp [s], each, torque [N m], turn [rad/s], silence [s]
    "falcon": (FULL_SCALE / PER_TORQUE, 8.0, 1.5, FALCON_BOX, 3, 0.5, True, None, math.inf, 0.5),
    "inverse3": (10.0, 10.0, 2.0, ANYWHERE, 2, 0.5, False, None, math.inf, 0.5),
    "rawhid": (5.0, 5.0, 1.5, ANYWHERE, 3, 0.5, False, 0.25, 15.0, 0.5),
}
"""Except for the Falcon's command, this project chose these numbers; docs/devices.md lists them. Each determines what a
hand may feel, so a change must be made in the code, in the page and here."""
HAPTIC = ["falcon", "inverse3", "rawhid"]
DRIVERS = {"falcon": FalconDriver, "inverse3": Inverse3Driver, "rawhid": RawHidDriver}
PAGE = (Path(__file__).parents[2] / "docs" / "devices.md").read_text()


def test_every_limit_equals_that_of_its_source():
    assert {name: astuple(limits) for name, limits in LIMITS.items()} == ROWS


@pytest.mark.parametrize("name", DRIVERS)
def test_each_driver_has_its_row(name):
    assert DRIVERS[name].limits is LIMITS[name]


def test_a_sensor_accepts_no_command():
    assert NetFTDriver.limits.command == 0.0 and NetFTDriver.limits.silence == 2.5


def test_the_times_of_the_guard_equal_those_of_the_page():
    assert (guard.FALL, guard.MISSED, guard.SILENT, guard.STALE, guard.HORIZON) == (0.015, 3, 0.020, 0.010, 0.005)
    assert WATCHDOG == 20  # [ms] docs/raw_hid.md
    text = " ".join(PAGE.split())
    assert "falls to zero within 15 ms" in text and "three answers are missing or none came for 20 ms" in text
    assert "the command is older than 10 ms" in text and "by 5 ms at most" in text
    assert "does not answer for 0.5 s (a Net F/T 2.5 s)" in text


@pytest.mark.parametrize(
    ("row", "field"),
    [("command", 0), ("power to the hand", 1), ("speed", 2), ("`delay` of the controller, samples", 4)],
)
def test_the_page_lists_the_limits_of_the_code(row, field):
    (cells,) = re.findall(rf"^\| {re.escape(row)} \|(.*)\|$", PAGE, re.M)
    stated = [float(re.search(r"[\d.]+", cell)[0]) for cell in cells.split("|")]
    assert stated == [ROWS[name][field] for name in HAPTIC]


@pytest.mark.parametrize("name", HAPTIC)
def test_any_command_of_a_node_is_limited_in_size_and_power(name):
    """At rest the largest command applies; at half of the device's largest speed, or 3 rad/s, the largest power."""
    limit, power, speed, *_ = ROWS[name]
    moving = Guard(LIMITS[name], ramp=0.0)
    still = Guard(LIMITS[name], ramp=0.0)
    for k in range(1, 12):
        now = k * 1_000_000
        if name == "falcon":
            still.note_answer(DeviceSample(now, joints=(0.0,) * 3, position=(0.0, 0.0, 0.1)))
            moving.note_answer(DeviceSample(now, joints=(30e-3 * k,) * 3, position=(0.0, 0.0, 0.1)))
        else:
            still.note_answer(DeviceSample(now, position=(0.02, 0.1, 0.0)))
            moving.note_answer(DeviceSample(now, position=(0.02 + 0.5e-3 * speed * k, 0.1, 0.0)))
    sent = np.array(still.apply((1e3,) * 3, now, now))
    assert (np.abs(sent).max() if name == "falcon" else np.linalg.norm(sent)) == approx(limit, rel=1e-12)
    sent = np.array(moving.apply((1e3,) * 3, now, now))
    rate = np.array([30.0] * 3 if name == "falcon" else [0.5 * speed, 0.0, 0.0])
    assert sent @ rate == approx(min(power, limit / (1.0 if name == "falcon" else math.sqrt(3)) * rate.sum()))


def test_a_raw_hid_device_of_joints_has_limits_of_torque_and_angular_speed():
    """5 N on a lever of 0.05 m, and 1.5 m/s on one of 0.1 m, not 5 N m and 300 rad/s."""
    limits = LIMITS["rawhid"]
    for rate, stopped in ((14.0, False), (16.0, True), (-16.0, True), (300.0, True)):
        guard = Guard(limits, ramp=0.0)
        for k in range(1, 12):
            guard.note_answer(DeviceSample(k * 1_000_000, joints=(0.0, 1e-3 * rate * k, 0.0)))
        now = 11 * 1_000_000
        assert guard.why(now, now) == ("too fast" if stopped else ""), rate
    still = Guard(limits, ramp=0.0)
    still.note_answer(DeviceSample(1, joints=(0.0,) * 3))
    assert still.apply((5.0, -5.0, 2.5), 2, 2) == approx((0.25, -0.25, 0.125))
    assert limits.command == 0.25 / 0.05 and approx(limits.speed) == 15.0 * 0.1
    # While the command falls after an invalid sample it is still a torque.
    still.note_answer(DeviceSample(3, homed=False))
    assert max(map(abs, still.apply((5.0, -5.0, 2.5), 4, 4))) <= 0.25


def test_angles_that_are_no_numbers_remove_the_force():
    guard = Guard(LIMITS["rawhid"], ramp=0.0)
    guard.note_answer(DeviceSample(1, joints=(math.nan, 0.0, 0.0)))
    assert guard.why(2, 2) == "no angles" and not any(guard.apply((1.0, 0.0, 0.0), 2, 2))


def test_the_page_states_the_limits_of_joints():
    text = " ".join(PAGE.split())
    assert "0.25 N m a joint" in text and "15 rad/s" in text


def test_the_largest_torque_of_a_falcon_gives_its_largest_motor_word():
    assert frames.motors((0.4096, -0.4096, 0.2048)) == (-FULL_SCALE, FULL_SCALE, -FULL_SCALE // 2)
    assert frames.motors((0.8192, 0.0, 0.0)) == (-FULL_SCALE, 0, 0)


def test_a_run_in_separate_processes_sends_torque_to_its_device(tmp_path):
    """On the real clock with one process per node: the press pushes the hand back, and `used` has the torque's tick."""
    press = "device.path=[{hold: 0.1}, {to: [0, 0, 0.0935], time: 0.3}, {hold: 0.8}]"
    launch = find("kidney").but(
        overrides=[press], duration=1.2, clock="real", record=tmp_path / "r.mcap", place="apart"
    )
    outcome = execute(launch, patience=60.0)
    assert outcome.result.ok, outcome.result.deaths
    recording = Recording(tmp_path / "r.mcap")
    used = np.array([m.used[0] for m in recording.messages("device")])
    assert np.mean(used >= 0) > 0.02, "the device received hardly any torque"
    torques = {m.tick: np.abs(m.torques).max() for m in recording.messages("statics")}
    assert max(torques.get(tick, 0.0) for tick in used) > 1e-3
    held = [m.position[2] for m in recording.messages("finger") if m.time > 600_000_000]
    assert max(held) > 0.0935 + 5e-4, "the hand was not pushed back from its target"
