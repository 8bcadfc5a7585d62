"""Haply's Inverse3: its messages, and the driver with an emulator."""

import json
import time

import pytest
from pytest import approx

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.hand import Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.haply import inverse3
from palpate.drivers.transport.websocket import WebSocket


def cycled(driver, command, seconds):
    """The last sample after this running time of the machine."""
    left, looked, sample = seconds, time.monotonic(), None
    while left > 0.0:
        sample = driver.cycle(command) or sample
        moment = time.monotonic()
        left, looked = left - min(moment - looked, 0.02), moment
    return sample


def test_a_command_has_the_format_of_the_service():
    text = json.loads(inverse3.command("04EF", (1.0, 0.0, -2.5)))
    assert text == {
        "inverse3": [
            {"device_id": "04EF", "commands": {"set_cursor_force": {"values": {"x": 1.0, "y": 0.0, "z": -2.5}}}}
        ]
    }


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"inverse3": 3}', "\x00"])
def test_an_invalid_message_is_not_a_state(text):
    assert inverse3.position(inverse3.state(text)) is None


def service(**more):
    emulated = inverse3.EmulatedService(Script(stiffness=300.0, damping=15.0), **more)
    return emulated, inverse3.Inverse3Driver(lambda: WebSocket(emulated.address, inverse3.NAME), more.get("device", ""))


def test_a_force_moves_the_inverse3_over_a_real_socket():
    emulated, driver = service()
    try:
        driver.open()
        sample = cycled(driver, (0.3, 0.0, 0.6), 1.0)
        assert sample.position == approx((1e-3, 0.0, 0.112), abs=5e-5)
        driver.close()
    finally:
        emulated.close()


def test_the_emulator_leaves_processor_time_to_the_force_loop():
    """The kernel stops a real-time process that never sleeps for 50 ms of each second: the hand moved on meanwhile."""
    emulated, driver = service()
    try:
        driver.open()
        begun = time.monotonic_ns()
        answers = sum(driver.cycle((0.0, 0.0, 0.0)) is not None for _ in range(100))
        assert time.monotonic_ns() - begun >= (answers - 1) * inverse3.ANSWER and answers > 50
        driver.close()
    finally:
        emulated.close()


def test_a_missing_service_and_missing_or_ambiguous_devices_are_errors():
    with pytest.raises(DeviceError, match=r"no Haply Inverse service at ws://127\.0\.0\.1:9: .*Start it"):
        WebSocket("ws://127.0.0.1:9", inverse3.NAME)
    for ids, text in (((), "knows no Inverse3. Plug it in"), (("A1", "B2"), "`device_id` to one of: A1, B2")):
        emulated, driver = service(ids=ids)
        try:
            with pytest.raises(DeviceError, match=text):
                driver.open()
            driver.close()
        finally:
            emulated.close()


def test_a_service_that_ends_is_an_error():
    emulated, driver = service(faults=EmulatedFaults(unplug=0.2))
    try:
        driver.open()
        with pytest.raises(DeviceError, match=r"is gone\. Start it again") as raised:
            cycled(driver, (0.0, 0.0, 0.0), 5.0)
        assert raised.value.lost
    finally:
        emulated.close()
