"""The force sensor: its bytes, and its node with an emulator on a real socket."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx

from palpate.drivers import exchange
from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.errors import DeviceError
from palpate.drivers.guard import DeviceSample
from palpate.drivers.sensors import netft
from palpate.drivers.transport.burst import MOST
from palpate.launch.testing import FakeBus
from palpate.messages import Pose
from palpate.nodes.sensor import NetFT


def pressing(now):
    return (0.1, -0.2, -3.5, 0.01, 0.02, 0.03)


def sample(driver, seconds=5.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if (reading := driver.cycle(())) is not None:
            return reading
    raise AssertionError("no sample")


def test_the_request_and_the_sample_have_the_documented_bytes():
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
def test_the_scale_is_read_from_the_sensor(text, force, torque):
    assert netft.scale(text) == approx((force, torque), rel=1e-4)


@pytest.mark.parametrize("text", [b"", b"<html></html>", b"<n><cfgcpf>x</cfgcpf><cfgcpt>1</cfgcpt></n>"])
def test_the_web_page_of_another_device_is_an_error(text):
    with pytest.raises(DeviceError, match=r"has no counts per force and torque.*Is this a Net F/T\?"):
        netft.scale(text)


def test_a_net_ft_streams_and_lost_samples_are_counted():
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


def test_a_fast_net_ft_does_not_block_a_cycle(monkeypatch):
    sensor = netft.EmulatedNetFT(pressing, rate=3000.0)
    driver = sensor.driver()
    try:
        driver.open()
        sample(driver)
        reads, read = [], driver.port.read
        monkeypatch.setattr(driver.port, "read", lambda timeout: reads.append(timeout) or read(timeout))
        for _ in range(20):
            driver.cycle(())
        assert len(reads) <= 20 * (MOST + 1)
    finally:
        driver.close()
        sensor.close()


def test_a_missing_net_ft_is_an_error():
    with pytest.raises(DeviceError, match=r"no Net F/T at 127\.0\.0\.1: .*refused.*192\.168\.1\.1"):
        netft.NetFTDriver("127.0.0.1", web=9).open()
    with pytest.raises(DeviceError, match="give its address as `port`"):
        netft.NetFTDriver("").open()


def test_a_sensor_node_sends_the_measured_force():
    # The press starts late, so that a stall during the measurement of the zero does not include its force.
    node = NetFT(port="emulator", stiffness=1e3, exponent=1.0, damping=0.0, tare=0.05, normal=[0.0, 0.6, 0.8])
    try:
        bus = FakeBus(node)
        first = bus.run(1)[0]
        for _ in range(200):
            bus.run(1)
            time.sleep(0.002)
        bus.hold("pose", Pose(position=(0.0, -1.5e-3, -2e-3), velocity=(0.0, 0.0, 0.0), dt=1e-3))  # 2.5 mm deep
        assert first.force == 0.0 and first.normal == approx((0.0, 0.6, 0.8))
        forces: list[float] = []
        while len(forces) < 4000 and (not forces or forces[-1] < 2.48):
            forces.append(bus.run(1)[0].force)
            time.sleep(0.002)
        assert forces[-1] == approx(2.5, rel=0.01), forces[-5:]
        assert np.all(np.array(forces) >= 0.0)
    finally:
        node.stop()


@pytest.mark.parametrize(("rate", "oldest"), [(0.0, 20_000_000), (1000.0, 20_000_000), (50.0, 59_999_000)])
def test_the_force_of_a_silent_sensor_is_zero_and_counted(monkeypatch, rate, oldest):
    driver, clock = netft.NetFTDriver("127.0.0.1"), [0]
    monkeypatch.setattr(exchange, "time", SimpleNamespace(monotonic_ns=lambda: clock[0]))
    link = exchange.Exchange(driver, NetFT(tare=0.0).guard(driver))
    link.rate, link._newest = rate, (DeviceSample(time=0, wrench=(0.0, 0.0, -3.0, 0.0, 0.0, 0.0)), ((), ()))
    for age in (0, oldest):
        clock[0] = age
        assert link.sample().wrench[2] == -3.0 and link.notes() == []
    for age in (oldest + 2_000, 2_000_000_000):
        clock[0] = age
        assert link.sample().wrench == ()
    silent = "steps in which the sensor was silent: no force"
    assert link.notes() == [f"the {netft.NAME}: 2 {silent}; more are counted"]
    link.sample()
    link._newest = DeviceSample(time=clock[0], wrench=(0.0, 0.0, -3.0, 0.0, 0.0, 0.0)), ((), ())
    assert link.sample().wrench[2] == -3.0 and link.notes() == []
    link.stop()
    assert link.notes() == [f"the {netft.NAME}: 3 {silent}"] and link.notes() == []
