"""Force sensors: their bytes, and their nodes against emulators at the other end of real sockets and lines."""

import itertools
import os
import pty
import struct
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from palpate.drivers.checksums import crc16_x25
from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.line import EmulatedLine
from palpate.drivers.errors import DeviceError
from palpate.drivers.sensors import bota, netft
from palpate.drivers.transport import serial as serial_line
from palpate.drivers.transport.serial import SerialLine
from palpate.launch.testing import FakeBus
from palpate.nodes.sensor import Bota, NetFT

F32 = st.floats(-1e3, 1e3, width=32)


def test_the_check_sum_is_that_of_the_catalogue():
    assert crc16_x25(b"123456789") == 0x906E
    assert crc16_x25(b"city of angels") == 0x5386


def test_a_bota_frame_byte_for_byte():
    data = bota.frame(bota.Reading(0, (1.0, -2.0, 0.5, 0.0, 0.25, -0.125), 7, 30.0))
    assert len(data) == 37 and data[:1] == b"\xaa"
    assert data[1:7] == b"\x00\x00" + struct.pack("<f", 1.0)
    assert data[27:31] == b"\x07\x00\x00\x00"


@given(st.lists(st.one_of(st.binary(max_size=9), st.tuples(*[F32] * 6)), max_size=8), st.integers(1, 50))
def test_the_reader_finds_bota_frames_in_any_rubbish(parts, piece):
    stream, sent = b"", []
    for part in parts:
        if isinstance(part, bytes):
            stream += part.replace(b"\xaa", b"x")
        else:
            sent.append(bota.Reading(0, part, 5, 20.0))
            stream += bota.frame(sent[-1])
    reader, received = bota.BotaFrameReader(), []
    for i in range(0, len(stream), piece):
        received += reader.feed(stream[i : i + piece])
    assert received == sent


def test_a_wrong_byte_costs_one_bota_frame():
    good = [bota.frame(bota.Reading(0, (float(i),) * 6, i, 20.0)) for i in range(4)]
    spoilt = bytearray(good[1])
    spoilt[20] ^= 4
    readings = bota.BotaFrameReader().feed(good[0] + bytes(spoilt) + good[2] + good[3])
    assert [r.time for r in readings] == [0, 2, 3]


def pressing(now):
    return (0.1, -0.2, -3.5, 0.01, 0.02, 0.03)


def sample(driver, seconds=5.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if (reading := driver.cycle(())) is not None:
            return reading
    raise AssertionError("no sample")


def test_a_bota_is_set_up_and_read_over_a_real_line():
    line = EmulatedLine(bota.EmulatedBota(pressing), bota.BAUD, bota.NAME)
    driver = bota.Bota(line.connect, sinc=128)
    driver.open()
    try:
        assert line.device.running and line.device.sinc == 128
        assert sample(driver).wrench == approx(pressing(0), rel=1e-6)
    finally:
        driver.close()


def test_a_bota_that_runs_already_is_set_up_again():
    device = bota.EmulatedBota(pressing)
    device.running = device.started = True
    driver = bota.Bota(EmulatedLine(device, bota.BAUD, bota.NAME).connect)
    driver.open()
    sample(driver)
    driver.close()


def test_a_bota_survives_wrong_bytes_and_dropouts():
    line = EmulatedLine(
        bota.EmulatedBota(pressing), bota.BAUD, bota.NAME, EmulatedFaults(garbled=0.2, dropouts=0.1, seed=2)
    )
    driver = bota.Bota(line.connect)
    driver.open()
    try:
        for _ in range(60):
            assert sample(driver).wrench == approx(pressing(0), rel=1e-6)
        assert driver.reader.wrong > 0
    finally:
        driver.close()


def test_something_else_on_the_line_is_told():
    class Silent:
        period = 0.0

        def hear(self, data, now):
            return [b"ERROR\r\n"]

        def say(self, now):
            return b""

    driver = bota.Bota(EmulatedLine(Silent(), 9600, "thing").connect)
    with pytest.raises(DeviceError, match=r"does not answer 'C': \d+ bytes without its answer came\. Is this its port"):
        driver.open()
    driver.close()


def test_a_port_that_is_not_there_is_told():
    with pytest.raises(DeviceError, match=r"no port /dev/ttyNONE\. There (is|are)"):
        SerialLine("/dev/ttyNONE", 9600, "Bota")
    with pytest.raises(DeviceError, match="give it as `port`"):
        SerialLine("", 9600, "Bota")


def test_a_line_on_a_machine_that_stood_still_while_it_was_written_to_is_not_gone(monkeypatch):
    serial = pytest.importorskip("serial")
    clock = itertools.count(0.0, 5.0)  # each look at it is 5 s later
    monkeypatch.setattr(serial.serialutil.Timeout, "TIME", staticmethod(lambda: next(clock)))
    master, slave = pty.openpty()
    line = SerialLine(os.ttyname(slave), bota.BAUD, bota.NAME)
    line.write(b"whole")
    assert os.read(master, 100) == b"whole"
    line.close()
    os.close(slave)
    os.close(master)


def test_a_line_that_takes_nothing_any_more_is_gone(monkeypatch):
    monkeypatch.setattr(serial_line, "ROOM", 0.05)
    master, slave = pty.openpty()
    line = SerialLine(os.ttyname(slave), bota.BAUD, bota.NAME)
    with pytest.raises(DeviceError, match="gone") as told:
        line.write(bytes(1 << 20))
    assert told.value.lost
    line.close()
    os.close(slave)
    os.close(master)


def test_an_unplugged_line_is_gone():
    line = EmulatedLine(bota.EmulatedBota(pressing), bota.BAUD, bota.NAME)
    driver = bota.Bota(line.connect)
    driver.open()
    sample(driver)
    line.close()
    with pytest.raises(DeviceError, match="gone") as told:
        for _ in range(100):
            driver.cycle(())
    assert told.value.lost
    driver.close()


def test_the_net_ft_request_and_sample_byte_for_byte():
    assert netft.REQUEST.pack(netft.MAGIC, netft.STREAM, 0) == bytes.fromhex("12340002 00000000")
    assert netft.SAMPLE.size == 36


@pytest.mark.parametrize(
    ("text", "force", "torque"),
    [
        (b"<netft><cfgcpf>1000000</cfgcpf><cfgcpt>500000</cfgcpt></netft>", 1e-6, 2e-6),
        (b"<n><cfgcpf>1000</cfgcpf><cfgcpt>10</cfgcpt><scfgfu>kN</scfgfu><scfgtu>N-mm</scfgtu></n>", 1.0, 1e-4),
        (b"<n><cfgcpf>9</cfgcpf><cfgcpt>8</cfgcpt><scfgfu>lbf</scfgfu><scfgtu>lbf-in</scfgtu></n>", 0.49425, 0.014123),
    ],
)  # fmt: skip
def test_the_scale_is_the_sensors_own(text, force, torque):
    assert netft.scale(text) == approx((force, torque), rel=1e-4)


@pytest.mark.parametrize("text", [b"", b"<html></html>", b"<n><cfgcpf>x</cfgcpf><cfgcpt>1</cfgcpt></n>"])
def test_a_page_of_something_else_is_told(text):
    with pytest.raises(DeviceError, match=r"has no counts per force and torque.*Is this a Net F/T\?"):
        netft.scale(text)


def test_a_net_ft_streams_and_counts_what_was_lost():
    sensor = netft.EmulatedNetFT(pressing, EmulatedFaults(dropouts=0.3, seed=1))
    driver = sensor.driver()
    try:
        driver.open()
        for _ in range(50):
            assert sample(driver).wrench == approx(pressing(0), abs=1e-6)
        assert driver.lost > 0
    finally:
        driver.close()
        sensor.close()


def test_a_net_ft_that_sends_faster_than_it_is_read_does_not_hold_a_cycle():
    sensor = netft.EmulatedNetFT(pressing, rate=3000.0)
    driver = sensor.driver()
    try:
        driver.open()
        sample(driver)
        begun = time.monotonic()
        for _ in range(20):
            driver.cycle(())
        assert time.monotonic() - begun < 60.0
    finally:
        driver.close()
        sensor.close()


def test_no_net_ft_at_an_address_is_told():
    with pytest.raises(DeviceError, match=r"no Net F/T at 127\.0\.0\.1: .*refused.*192\.168\.1\.1"):
        netft.NetFT("127.0.0.1", web=9).open()
    with pytest.raises(DeviceError, match="give its address as `port`"):
        netft.NetFT("").open()


@pytest.mark.parametrize("kind", [NetFT, Bota])
def test_a_sensor_node_sends_the_force_on_it(kind):
    # Nothing presses for long: a machine that stands still while the zero is taken does not take the force for it.
    node = kind(port="emulator", times=[0.0, 3.0, 3.01], forces=[0.0, 0.0, 2.5], tare=0.05, normal=[0.0, 0.6, 0.8])
    try:
        bus = FakeBus(node)
        first = bus.run(1)[0]
        assert first.force == 0.0 and first.normal == approx((0.0, 0.6, 0.8))
        forces: list[float] = []
        while len(forces) < 4000 and (not forces or forces[-1] < 2.48):
            forces.append(bus.run(1)[0].force)
            time.sleep(0.002)
        assert forces[-1] == approx(2.5, rel=0.01), forces[-5:]
        assert np.all(np.array(forces) >= 0.0)
    finally:
        node.stop()
