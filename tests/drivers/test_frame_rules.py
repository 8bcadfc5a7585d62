"""A field of a frame that says whether, when and in which unit the rest is true: one generator breaks each of them.

Drivers are found by their place; each declares its validity bits, order, range and units as data (`rules`). For every
driver and each of its declared fields, frames with this field broken are no samples, the guard's command is zero within
FALL of the first one (and of the frames that the driver bridges), and a note counts them.
"""

import ast
import importlib
import importlib.util
import math
import pkgutil
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from sources import nodes

import palpate.drivers
from palpate.drivers.errors import DeviceError
from palpate.drivers.exchange import Exchange
from palpate.drivers.falcon.driver import FalconDriver
from palpate.drivers.frame import FOREIGN, FROZEN, LATE, SATURATED, FrameOrder, FrameRules, Measured
from palpate.drivers.guard import FALL, MISSED, SILENT, Guard
from palpate.drivers.haply.inverse3 import ENCODED, Inverse3Driver
from palpate.drivers.hid import raw
from palpate.drivers.sensors import netft
from palpate.nodes.device.hardware import state as device_state

MS = 1_000_000
ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))


def is_driver(kind: object) -> bool:
    return isinstance(kind, type) and callable(getattr(kind, "cycle", None)) and hasattr(kind, "limits")


def found_drivers() -> dict[str, type]:
    """The drivers in the files of `drivers`, and those of the examples."""
    found = {}
    for info in pkgutil.walk_packages(palpate.drivers.__path__, "palpate.drivers."):
        module = importlib.import_module(info.name)
        for kind in vars(module).values():
            if (
                is_driver(kind)
                and kind.__module__ == info.name
                and "name" in vars(kind)
                and not kind.__module__.endswith(".exchange")
            ):
                found[kind.__name__] = kind
    for path in EXAMPLES:
        if any(isinstance(node, ast.FunctionDef) and node.name == "cycle" for node in nodes(path)):
            spec = importlib.util.spec_from_file_location(path.stem, path)
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            found |= {
                kind.__name__: kind
                for kind in vars(module).values()
                if is_driver(kind) and kind.__module__ == path.stem
            }
    return found


class Clock:
    """The time of the drivers and of their peers."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now = 10**12
        fake = SimpleNamespace(monotonic=lambda: self.now * 1e-9, monotonic_ns=lambda: self.now)
        for name, module in list(sys.modules.items()):
            if name.startswith("palpate.drivers") and getattr(module, "time", None) is time:
                patch.setattr(module, "time", fake)


class Link:
    """The connection of a driver: what its peer has sent, then nothing. `wrap`: the form in which it is read."""

    def __init__(self, clock: Clock, wrap=lambda data: data) -> None:
        self.clock, self.wrap, self.waiting = clock, wrap, []

    def write(self, data): ...

    def control(self, request, value): ...

    def close(self): ...

    def read(self, *given):
        if self.waiting:
            return self.wrap(self.waiting.pop(0))
        self.clock.now += max(1, round(given[-1] * 1e9)) if given[-1] > 0.0 else 0
        return "" if self.wrap("") == "" else b""


def falcon(clock):
    link = Link(clock, lambda data: b"\x01\x60" + (data if isinstance(data, bytes) else b""))
    driver = FalconDriver(lambda: link, clock=lambda: clock.now)
    driver._answers = lambda: True
    driver.open()
    return driver, link


def rawhid(clock, flags=0):
    link = Link(clock, lambda data: data or b"")
    driver = raw.RawHidDriver(lambda: link)
    driver.port, driver.info = link, raw.Info(flags, 3, (1e-5,) * 6, (1e-3,) * 6)
    driver.begin()
    return driver, link


def inverse3(clock):
    link = Link(clock)
    driver = Inverse3Driver(lambda: link)
    driver.port, driver.chosen, driver.calm = link, ENCODED, 100
    return driver, link


def sensor(clock):
    link = Link(clock, lambda data: data or b"")
    driver = netft.NetFTDriver("nowhere")
    driver.port, driver.scale, driver.asked = link, netft.Scale(1e-6, 1e-6), clock.now * 1e-9
    return driver, link


HARNESS = {
    "FalconDriver": (falcon, (10, 10, 10), 3),
    "RawHidDriver": (rawhid, (10, 20, 30), 3),
    "RawHidDriver of joints": (lambda clock: rawhid(clock, raw.TORQUES), (10, 20, 30), 3),
    "Inverse3Driver": (inverse3, (0.01, 0.02, 0.03), 3),
    "NetFTDriver": (sensor, (1, 2, 3, 4, 5, 6), 0),
}
"""How to connect each driver with a peer, numbers of a valid frame, and the size of its command."""
WITHOUT_FRAMES = {"DhdDriver": "the vendor's library checks the frames"}


def test_every_driver_declares_its_frames_and_has_a_harness():
    drivers = found_drivers()
    assert len(drivers) >= 5 and {name.partition(" ")[0] for name in HARNESS} | WITHOUT_FRAMES.keys() == drivers.keys()
    for name, kind in drivers.items():
        assert isinstance(kind.rules, FrameRules), name
        assert kind.rules.units and set(kind.rules.units) <= {"m", "rad", "N", "N m"}, name
        if name not in WITHOUT_FRAMES:
            assert kind.rules.status or kind.rules.homed, f"{name}: nothing says whether its numbers are valid"


def broken(rules: FrameRules, values: tuple):
    """Each declared field, broken: a name, the expected reason, and a function of the last valid number n and of the
    number k = 1, 2 ... of a broken frame, which returns the arguments of `encode`."""
    good = {"values": values, "status": rules.good}

    def numbered(n, k, **more):
        return good | {"number": (n + k) % (rules.numbers or 1 << 62), "measured": (n + k) % (1 << 32)} | more

    for bits, text in rules.status.items():
        status = (rules.good | bits) if isinstance(bits, int) else (bits,)
        yield f"status {bits}", text, lambda n, k, status=status: numbered(n, k, status=status)
    for bit in range(32) if rules.homed else ():
        if rules.homed >> bit & 1:
            yield f"not homed {bit}", "", lambda n, k, bit=bit: numbered(n, k, status=rules.good & ~(1 << bit))
    if rules.valid:
        yield "unknown status", "unknown error", lambda n, k: numbered(n, k, status=1 << 12)
    if rules.numbers:
        half = rules.numbers // 2
        yield "repeated", LATE, lambda n, k: numbered(n, 0)
        yield "late", LATE, lambda n, k: numbered(n, -k - 1)
        yield "late by half", LATE, lambda n, k: numbered(n, half + 1)
    if rules.measured:
        yield "frozen", FROZEN, lambda n, k: numbered(n, k, measured=n % (1 << 32))
    if rules.counts:
        for i in range(len(values)):
            for end in (rules.counts[0] - 1, rules.counts[1] + 1):
                full = tuple(end if j == i else v for j, v in enumerate(values))
                yield f"saturated {i} {end}", SATURATED, lambda n, k, full=full: numbered(n, k, values=full)
    elif all(isinstance(v, float) for v in values):
        for wrong in ("0.01", "inf", True, None, [0.01], {}, math.nan, math.inf, 1e300, 10**400):
            for i in range(len(values)):
                other = tuple(wrong if j == i else v for j, v in enumerate(values))
                yield f"number {i} {str(wrong)[:6]}", FOREIGN, lambda n, k, other=other: numbered(n, k, values=other)


def cases():
    for name, (_, values, _) in HARNESS.items():
        rules = found_drivers()[name.partition(" ")[0]].rules
        for case, reason, frame in broken(rules, values):
            yield pytest.param(name, reason, frame, id=f"{name}, {case}")


CASES = list(cases())


@pytest.mark.parametrize(("name", "reason", "frame"), CASES)
def test_a_broken_field_removes_the_force_and_is_counted(name, reason, frame, monkeypatch):
    connect, values, size = HARNESS[name]
    clock = Clock(monkeypatch)
    driver, link = connect(clock)
    rules, guard = driver.rules, Guard(driver.limits, ramp=0.0)
    exchange = Exchange(driver, guard)
    first = max(rules.numbers, 1 << 32) - 20  # the numbers begin again meanwhile
    sent, samples, command = [], [], (0.01,) * size

    def cycle(**fields):
        clock.now += MS
        link.waiting.append(rules.encode(**fields))
        sent.append(guard.apply(command, clock.now, clock.now))
        samples.append(driver.cycle(sent[-1]))
        guard.note_answer(samples[-1])
        exchange._newest = samples[-1] or exchange._newest[0], guard.rates()

    n = first
    for n in range(first, first + 40):
        cycle(values=values, status=rules.good, number=n % (rules.numbers or 1 << 62), measured=n % (1 << 32))
    assert samples[-1] is not None and samples[-1].homed and not driver.refused
    assert all(c != 0.0 for c in sent[-1]) and exchange.sample().homed

    for k in range(1, 80):
        try:
            cycle(**frame(n, k))
        except DeviceError as error:  # the exchange then sends zero commands, and the run ends with this line
            assert reason in str(error) and not error.lost and k == 1
            return
    absent = [sample is None or not sample.homed for sample in samples[40:]]
    grace = round(SILENT * 1e3) + 1 if reason == FROZEN else rules.bridged
    assert all(absent[grace:]), "a broken frame is no sample"
    if size:
        zero = next(i for i, c in enumerate(sent[40:]) if not any(c))
        allowed = grace + (MISSED if reason == LATE else 1) + round(FALL * 1e3)
        assert zero <= allowed and not any(map(any, sent[40 + zero :]))
        assert not device_state(samples[-1]).homed
    else:
        assert samples[-1] is None or samples[-1].wrench == ()
    if reason:
        assert sum(count for why, count in driver.refused.items() if reason in why) >= 79 - grace - 25
        (note,) = exchange.notes()
        assert driver.name in note and reason in note and "left out; more are counted" in note
        exchange._stop.set()
        assert not exchange.notes() or driver.name in exchange.notes()[0]


def test_the_generator_breaks_this_many_fields():
    count = {name: sum(case.values[0] == name for case in CASES) for name in HARNESS}
    assert count == {
        "FalconDriver": 9, "RawHidDriver": 12, "RawHidDriver of joints": 12, "Inverse3Driver": 34, "NetFTDriver": 28,
    }  # fmt: skip


def test_late_and_repeated_numbers_are_dropped():
    order = FrameOrder(FrameRules(("N",), netft.encode, numbers=1 << 32))
    assert [order.take(n) for n in (10, 12, 11, 11, 5, 13)] == [True, True, False, False, False, True]
    assert order.lost == 1


def test_numbers_begin_again():
    order = FrameOrder(FrameRules(("N",), netft.encode, numbers=1 << 32))
    assert [order.take(n % 2**32) for n in (2**32 - 2, 2**32 - 1, 2**32, 2**32 + 1)] == [True] * 4 and not order.lost
    assert not order.take(2**32 - 1) and not order.take(0) and order.take(3) and order.lost == 1
    order.restart()
    assert order.take(1) and order.lost == 1


def test_a_device_without_times_of_its_measurements_is_not_frozen():
    measured = Measured()
    for now in range(0, 100 * MS, MS):
        assert measured.arrival(0, now) == now and not measured.frozen(now)
    assert measured.arrival(7, 100 * MS) == 100 * MS and measured.arrival(7, 150 * MS) == 100 * MS
    assert measured.frozen(121 * MS) and not measured.frozen(120 * MS)


@pytest.mark.parametrize("status", [0, 1 << 16, 1 << 31 | 1 << 16])
def test_a_monitor_condition_of_a_net_ft_is_no_error(status):
    """The user of the sensor sets these conditions (ATI 9610-05-Ethernet Axia-09, table 4.9)."""
    assert netft.NetFTDriver.rules.fault(status) == ""


@pytest.mark.parametrize(
    ("status", "text"),
    [(0x80000001, "temperature"), (0x80000002, "supply voltage"), (0x80000004, "broken gauge"),
     (0x88000000, "gauge out"),
     (0x10000000, "simulated"), (0xA0000000, "checksum"), (0xC0000000, "force or torque out of range"),
     (0x80000000, "error"), (0x88010000, "gauge out")],
)  # fmt: skip
def test_the_bit_patterns_of_the_manual_are_errors(status, text):
    """ATI, manual 9610-05-Ethernet Axia-09, table 4.9."""
    assert text in netft.NetFTDriver.rules.fault(status)
