"""HID devices: the open raw-HID protocol and its reference firmware."""

import os
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.hand import Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.hid import emulator, raw
from palpate.drivers.transport.hid import UsbHid, hidapi

FIRMWARE = Path(__file__).parents[2] / "docs" / "examples" / "raw_hid"
I16, I32, U16 = st.integers(-0x8000, 0x7FFF), st.integers(-(2**31), 2**31 - 1), st.integers(0, 0xFFFF)


def test_the_real_library_reports_a_missing_device():
    with pytest.raises(DeviceError, match=rf"no {raw.NAME} on USB or Bluetooth\. Plug it in"):
        UsbHid(lambda entry: False, raw.NAME)


def test_the_hidraw_module_of_hidapi_is_used():
    """The libusb module has no usage pages, which identify a raw-HID device, and has other paths."""
    assert "hidraw" in Path(hidapi().__file__).name


def test_several_devices_unknown_ports_and_missing_permissions_are_errors(monkeypatch):
    listed = [{"path": f"/dev/hidraw9{i}".encode(), "serial_number": f"S{i}"} for i in range(2)]
    monkeypatch.setattr(hidapi(), "enumerate", lambda: listed)
    with pytest.raises(DeviceError, match=rf"2 devices are a {raw.NAME}\. Say which one with `port`: /dev/hidraw90"):
        UsbHid(lambda entry: True, raw.NAME)
    with pytest.raises(DeviceError, match=r"at port 'S7'\. There are: /dev/hidraw90, /dev/hidraw91"):
        UsbHid(lambda entry: True, raw.NAME, "S7")
    with pytest.raises(DeviceError, match=r"at /dev/hidraw91: no permission.*--install-udev"):
        UsbHid(lambda entry: True, raw.NAME, "S1")


def test_the_checksum_has_the_published_value():
    assert raw.crc16_x25(b"123456789") == 0x906E


@given(U16, st.integers(0, 7), U16, st.tuples(*[I16] * 6))
def test_a_command_survives_a_round_trip(sequence, flags, watchdog, values):
    message = raw.RawCommand(sequence, flags, watchdog, values)
    assert len(raw.pack(message)) == 64 and raw.unpack(raw.pack(message)) == message


@given(U16, U16, st.integers(0, 7), st.integers(0, 2**32 - 1), st.tuples(*[I32] * 6), U16)
def test_a_state_survives_a_round_trip(sequence, received, flags, stamp, counts, buttons):
    message = raw.RawState(sequence, received, flags, 3, stamp, counts, buttons)
    assert len(raw.pack(message)) == 64 and raw.unpack(raw.pack(message)) == message


@given(st.integers(0, 63), st.integers(1, 255))
def test_a_damaged_report_is_rejected(at, change):
    data = bytearray(raw.pack(raw.RawCommand(1, 1, 20, (1, 2, 3, 4, 5, 6))))
    data[at] ^= change
    assert raw.unpack(bytes(data)) is None


class Process:
    """The reference firmware in a process of this machine: `transport.hid.HidPort` over its standard streams."""

    def __init__(self, program):
        self.run = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        self.rest = b""

    def write(self, report):
        self.run.stdin.write(report)

    def read(self, size, timeout):
        end = time.monotonic() + timeout
        while len(self.rest) < 64 and (left := end - time.monotonic()) > 0:
            if select.select([self.run.stdout], [], [], left)[0]:
                self.rest += os.read(self.run.stdout.fileno(), 64)
        if len(self.rest) < 64:
            return b""
        report, self.rest = self.rest[:64], self.rest[64:]
        return report

    def close(self):
        self.run.stdin.close()
        self.run.wait(60)
        self.run.stdout.close()


@pytest.fixture(scope="module")
def firmware(tmp_path_factory):
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no g++ on this machine")
    program = tmp_path_factory.mktemp("firmware") / "host"
    subprocess.run(
        [compiler, "-std=c++17", "-Wall", "-Wextra", "-Werror", "-o", program, FIRMWARE / "host.cpp"], check=True
    )
    return program


def homed(driver):
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        sample = driver.cycle((0.0, 0.0, 0.0))
        if sample is not None and sample.homed:
            return sample
    raise AssertionError("not homed")


def test_the_reference_firmware_works_with_the_driver(firmware):
    driver = raw.RawHidDriver(lambda: Process(firmware))
    driver.open()
    try:
        assert driver.info.axes == 3 and driver.info.per_count[:3] == approx([20e-6] * 3)
        sample = homed(driver)
        assert sample.position == approx((0.0, 0.0, 0.11), abs=2e-5) and sample.buttons == 0b10
        rest = approx((2e-3, 0.0, 0.11 - 3e-3), abs=1e-4)  # its spring has 200 N/m
        there = 0
        for _ in range(60_000):  # on a busy machine its watchdog may stop the motors meanwhile
            sample = driver.cycle((0.4, 0.0, -0.6)) or sample
            there = there + 1 if sample.position == rest else 0
            if there >= 100:  # at rest, not passing through
                break
            time.sleep(0.001)
        assert there >= 100, sample
    finally:
        driver.close()


def test_the_reference_firmware_stops_its_motors_without_commands(firmware):
    driver = raw.RawHidDriver(lambda: Process(firmware))
    driver.open()
    try:
        homed(driver)
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            driver.cycle((0.0, 0.0, 2.0))
        time.sleep(0.6)  # 30 times the watchdog's time, and several of the spring's
        while driver.port.read(64, 0.05):  # late answers
            pass
        driver._send(raw.HOME, (0,) * 6)
        state = raw.unpack(driver.port.read(64, 5.0))
        assert state.flags & raw.TRIPPED
        assert state.counts[2] * 20e-6 == approx(0.11, abs=1e-4)
    finally:
        driver.close()


def test_a_force_moves_the_emulated_hand():
    device = emulator.EmulatedRawHid(Script(stiffness=300.0, damping=15.0))
    driver = raw.RawHidDriver(device.connect)
    driver.open()
    there = approx((0.0, 2e-3, 0.11), abs=5e-5)
    sample = None
    for _ in range(20_000):  # after a stall the watchdog removes the force, and the motion starts again
        sample = driver.cycle((0.0, 0.6, 0.0)) or sample
        if sample is not None and sample.position == there:
            break
    assert sample.position == there


def test_a_command_outside_its_range_is_scaled_as_a_whole():
    driver = raw.RawHidDriver(emulator.EmulatedRawHid().connect)
    driver.open()
    assert driver.units((100.0, -50.0, 0.0))[:3] == (32767, -16384, 0)


def test_faults_of_a_raw_hid_device():
    device = emulator.EmulatedRawHid(faults=EmulatedFaults(dropouts=0.1, garbled=0.1, seed=9))
    driver = raw.RawHidDriver(device.connect)
    driver.open()
    samples = [driver.cycle((0.0, 0.0, 0.0)) for _ in range(300)]
    lost = sum(s is None for s in samples)
    assert 30 < lost < 110
    assert all(s.position == approx((0.0, 0.0, 0.11), abs=1e-4) for s in samples if s)


def test_another_raw_hid_device_is_an_error():
    device = emulator.EmulatedRawHid()
    device.read = lambda size, timeout: b"\1" + bytes(12)
    driver = raw.RawHidDriver(device.connect)
    with pytest.raises(DeviceError, match=r"does not answer as docs/raw_hid\.md says"):
        driver.open()
