"""Haply's devices: the linkage by an independent route, their messages, and drivers against emulators."""

import json
import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.hand import Script
from palpate.drivers.emulate.line import EmulatedLine
from palpate.drivers.errors import DeviceError
from palpate.drivers.haply import diy, inverse3
from palpate.drivers.transport.websocket import WebSocket
from palpate.physics.device.pantograph import Pantograph, cranks, handle, jacobian

NEW = Pantograph()
PLACES = st.tuples(st.floats(-0.03, 0.07), st.floats(0.075, 0.135))


@given(PLACES)
def test_the_cranks_lead_back_to_the_handle(place):
    assert handle(NEW, *cranks(NEW, *place)) == approx(place, abs=1e-12)


@given(PLACES)
def test_the_rates_are_the_finite_differences(place):
    q = np.array(cranks(NEW, *place))
    rates = np.array(jacobian(NEW, *q))
    for i, step in enumerate(1e-6 * np.eye(2)):
        slope = (np.array(handle(NEW, *(q + step))) - np.array(handle(NEW, *(q - step)))) / 2e-6
        assert rates[:, i] == approx(slope, rel=1e-5, abs=1e-8)


def test_the_handle_is_at_one_links_length_from_both_elbows():
    q1, q2 = math.radians(140), math.radians(35)
    x, y = handle(NEW, q1, q2)
    assert math.hypot(x - 0.07 * math.cos(q1), y - 0.07 * math.sin(q1)) == approx(0.09)
    assert math.hypot(x - 0.038 - 0.07 * math.cos(q2), y - 0.07 * math.sin(q2)) == approx(0.09)


def test_links_that_do_not_meet_give_no_place():
    assert handle(Pantograph(apart=0.5), math.pi, 0.0) is None
    assert cranks(NEW, 0.5, 0.5) is None and jacobian(Pantograph(apart=0.5), math.pi, 0.0) is None


def test_links_in_one_line_have_no_rates_and_a_motor_is_no_place():
    wide = Pantograph(apart=0.1)
    for short, singular in ((1e-10, True), (1e-8, False)):  # of two links' length between the elbows
        q = math.acos((0.18 - short - 0.1) / 0.14)
        assert handle(wide, math.pi - q, q) is not None
        assert (jacobian(wide, math.pi - q, q) is None) == singular
    assert cranks(NEW, 0.0, 0.0) is None and cranks(NEW, NEW.apart, 0.0) is None


def test_the_2diys_messages_byte_for_byte():
    """As the maker's library puts them together for its plastic build."""
    assert diy.setup(3) == bytes((1, 5, 0b11, 1, 1, 0b11, 1, 1, 0, 0)) + b"".join(
        np.float32(v).tobytes() for v in (12, 4880, 168, 4880)
    )
    assert diy.torques(3, (0.25, -0.5)) == bytes.fromhex("0205") + np.float32([-0.5, 0.25]).tobytes()


def cycled(driver, command, seconds):
    """Its last sample after so much time in which the machine runs."""
    left, looked, sample = seconds, time.monotonic(), None
    while left > 0.0:
        sample = driver.cycle(command) or sample
        moment = time.monotonic()
        left, looked = left - min(moment - looked, 0.02), moment
    return sample


def test_a_2diy_gives_way_to_a_force_over_a_real_line():
    script = Script(points=((0.019, 0.11, 0.0),), stiffness=200.0, damping=12.0)
    driver = diy.Haply2Diy(EmulatedLine(diy.Emulated2Diy(script), diy.BAUD, diy.NAME).connect)
    driver.open()
    try:
        assert cycled(driver, (0.0, 0.0), 0.05).position == approx((0.019, 0.11, 0.0), abs=1e-4)
        assert cycled(driver, (0.6, -0.4), 1.0).position == approx((0.022, 0.108, 0.0), abs=2e-4)
    finally:
        driver.close()


def test_a_2diy_on_bad_days():
    script = Script(points=((0.019, 0.11, 0.0),))
    line = EmulatedLine(
        diy.Emulated2Diy(script), diy.BAUD, diy.NAME, EmulatedFaults(dropouts=0.1, garbled=0.05, seed=3)
    )
    driver = diy.Haply2Diy(line.connect)
    driver.open()
    try:
        samples = [driver.cycle((0.0, 0.0)) for _ in range(200)]
        assert 5 < sum(s is None for s in samples) < 100
    finally:
        driver.close()


def test_something_else_than_a_2diy_is_told():
    class Silent:
        period = 0.0

        def hear(self, data, now):
            return []

        def say(self, now):
            return b""

    driver = diy.Haply2Diy(EmulatedLine(Silent(), diy.BAUD, "thing").connect)
    with pytest.raises(DeviceError, match=r"does not answer\. Is this its port"):
        driver.open()
    driver.close()


def test_an_inverse3s_command_is_as_the_service_wants_it():
    text = json.loads(inverse3.command("04EF", (1.0, 0.0, -2.5)))
    assert text == {
        "inverse3": [
            {"device_id": "04EF", "commands": {"set_cursor_force": {"values": {"x": 1.0, "y": 0.0, "z": -2.5}}}}
        ]
    }


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"inverse3": 3}', "\x00"])
def test_rubbish_is_no_state(text):
    assert inverse3.position(inverse3.state(text)) is None


def service(**more):
    emulated = inverse3.EmulatedService(Script(stiffness=300.0, damping=15.0), **more)
    return emulated, inverse3.Inverse3(lambda: WebSocket(emulated.address, inverse3.NAME), more.get("device", ""))


def test_an_inverse3_gives_way_to_a_force_over_a_real_socket():
    emulated, driver = service()
    try:
        driver.open()
        sample = cycled(driver, (0.3, 0.0, 0.6), 1.0)
        assert sample.position == approx((1e-3, 0.0, 0.112), abs=5e-5)
        driver.close()
    finally:
        emulated.close()


def test_no_service_no_device_and_two_devices_are_told():
    with pytest.raises(DeviceError, match=r"no Haply Inverse service at ws://127\.0\.0\.1:9: .*Start it"):
        WebSocket("ws://127.0.0.1:9", inverse3.NAME)
    for ids, text in (((), "knows no Inverse3. Plug it in"), (("A1", "B2"), "`device_id`: A1, B2")):
        emulated, driver = service(ids=ids)
        try:
            with pytest.raises(DeviceError, match=text):
                driver.open()
            driver.close()
        finally:
            emulated.close()


def test_a_service_that_ends_is_gone():
    emulated, driver = service(faults=EmulatedFaults(unplug=0.2))
    try:
        driver.open()
        with pytest.raises(DeviceError, match=r"is gone\. Start it again") as told:
            cycled(driver, (0.0, 0.0, 0.0), 5.0)
        assert told.value.lost
    finally:
        emulated.close()
