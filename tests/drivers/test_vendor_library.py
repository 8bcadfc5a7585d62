"""The example of a driver over a vendor's library keeps the safety rules, with a stub library compiled here."""

import ctypes
import math
import runpy
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.drivers.errors import DeviceError
from palpate.launch.testing import FakeBus
from palpate.messages import Force

ROOT = Path(__file__).parents[2]
NODE = runpy.run_path(str(ROOT / "docs" / "examples" / "force_dimension.py"))["ForceDimension"]
STRONG = Force(force=(0.0, 30.0, 40.0), state="contact", energy=0.0)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler: apt install gcc")
    path = tmp_path_factory.mktemp("dhd") / "libdhd.so"
    source = ROOT / "tests" / "support" / "dhd_stub" / "dhd.c"
    subprocess.run([compiler, "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", source, "-o", path], check=True)
    stub = ctypes.CDLL(str(path))
    stub.stub_largest_squared.restype = stub.stub_force.restype = ctypes.c_double
    stub.stub_place.argtypes = [ctypes.c_double] * 3
    return path, stub


@pytest.fixture
def device(library):
    """A started node on a bus that asks for 50 N, and its stub."""
    path, stub = library
    stub.stub_reset()
    stub.stub_place(0.01, -0.02, 0.03)
    node = NODE(port=str(path), ramp=0.0)
    bus = FakeBus(node, force=STRONG)
    yield node, bus, stub
    node.stop()


def step(bus, until):
    """Steps of 1 ms until a condition; the last message."""
    for _ in range(5000):
        (message,) = bus.run(1)
        if until(message):
            return message
        time.sleep(0.001)
    pytest.fail("the condition did not come true within 5000 steps")


def test_the_position_arrives_and_the_force_is_that_of_the_limits(device):
    _, bus, stub = device
    message = step(bus, lambda m: m.homed and math.sqrt(stub.stub_largest_squared()) > 4.99)
    assert message.position == (0.01, -0.02, 0.03)
    assert stub.stub_watchdog() == 160 and stub.stub_enabled()
    step(bus, lambda m: stub.stub_commands() > 200)
    assert math.sqrt(stub.stub_largest_squared()) == pytest.approx(5.0)
    assert stub.stub_force(1) == pytest.approx(0.75 * stub.stub_force(2))


def test_a_fast_grip_feels_no_force(device):
    _, bus, stub = device
    step(bus, lambda m: stub.stub_force(2) > 3.9)
    begun = time.monotonic()

    def fast(message):
        stub.stub_place(3.0 * (time.monotonic() - begun), 0.0, 0.0)
        return stub.stub_zeros() > 5

    step(bus, fast)


def test_the_force_is_zero_and_the_motors_are_off_after_the_run(device):
    node, bus, stub = device
    step(bus, lambda m: stub.stub_force(2) > 3.9)
    node.stop()
    assert stub.stub_zeros() >= 3 and not stub.stub_enabled() and not stub.stub_opened()


def test_an_unplugged_device_ends_the_run_with_its_error(device):
    _, bus, stub = device
    step(bus, lambda m: stub.stub_commands() > 5)
    stub.stub_unplug(1)
    with pytest.raises(DeviceError, match="unplugged"):
        step(bus, lambda m: False)


def test_a_missing_library_or_device_is_an_error_with_a_remedy(library):
    path, stub = library
    with pytest.raises(DeviceError, match=r"found no /nowhere/libdhd.*set `port` to its path"):
        NODE(port="/nowhere/libdhd.so").start()
    stub.stub_reset()
    stub.stub_unplug(1)
    with pytest.raises(DeviceError, match="found no device"):
        NODE(port=str(path)).start()


def test_the_graph_of_the_page_loads_with_the_example(monkeypatch, capsys):
    monkeypatch.chdir(ROOT / "docs" / "examples")
    result = CliRunner().invoke(app, ["check", "cartesian", "--set", "device.use=force_dimension.ForceDimension"])
    assert result.exit_code == 0, result.output
