"""A device, its driver and the thread that serves it, in virtual time and one thread.

The product's `Exchange` runs with the product's drivers and emulators. Time passes where a connection waits for an
answer; meanwhile the graph takes the newest sample and gives its next command. A run has the same result on each
machine, and a second of it takes 20 to 100 ms.
"""

import math
import sys
import time
from collections import deque
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.hand import Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.exchange import Exchange
from palpate.drivers.falcon.driver import FalconDriver
from palpate.drivers.falcon.emulator import EmulatedFalcon
from palpate.drivers.guard import DeviceSample, Guard
from palpate.drivers.haply.inverse3 import EmulatedInverse3, Inverse3Driver
from palpate.drivers.hid import raw
from palpate.drivers.hid.emulator import EmulatedRawHid
from palpate.drivers.sensors import netft

MS = 1_000_000
READING = 50  # [ns] that it takes to read the clock


class VirtualTime:
    """The clock of the drivers, the emulators and the exchange. `at` [ns]; `tick` is called at each time in `due`."""

    def __init__(self, patch: Any) -> None:
        self.at = 10**12
        self.begun = self.at
        self.due, self.tick = 1 << 62, lambda: 0
        self.stalls: deque[tuple[int, int, bool]] = deque()
        fake = SimpleNamespace(monotonic=lambda: self.now() * 1e-9, monotonic_ns=self.now, sleep=self.sleep)
        for name, module in list(sys.modules.items()):
            if name.startswith("palpate.drivers") and getattr(module, "time", None) is time:
                patch.setattr(module, "time", fake)

    def now(self) -> int:
        self.at += READING  # a loop that only waits for a time must end
        return self.at

    def since(self) -> float:
        """Time [s] since the begin."""
        return (self.at - self.begun) * 1e-9

    def sleep(self, seconds: float) -> None:
        """Let the time pass, and a stall that is due: of the exchange alone, or of the graph as well."""
        self._pass(self.at + max(round(seconds * 1e9), 1))
        if self.stalls and self.stalls[0][0] <= self.at:
            _, duration, both = self.stalls.popleft()
            if both:
                self.at += duration
                self.due = max(self.due, self.at)
            else:
                self._pass(self.at + duration)

    def _pass(self, until: int) -> None:
        while self.due <= until:
            self.at = max(self.at, self.due)
            self.due = self.at + self.tick()
        self.at = max(self.at, until)


class StopEvent:
    """`threading.Event` in virtual time."""

    def __init__(self, clock: VirtualTime) -> None:
        self.clock, self._set = clock, False

    def is_set(self) -> bool:
        return self._set

    def set(self) -> None:
        self._set = True

    def wait(self, seconds: float) -> bool:
        if not self._set:
            self.clock.sleep(seconds)
        return self._set


class _Link:
    """A connection to an emulator without a network: answers with the times at which they arrive."""

    def __init__(self, clock: VirtualTime, empty: Any) -> None:
        self.clock, self.empty = clock, empty
        self.answers: deque[tuple[int, Any]] = deque()

    def read(self, timeout: float) -> Any:
        end = self.clock.at + round(timeout * 1e9)
        due = self.answers[0][0] if self.answers else end + 1
        if (left := min(due, end) - self.clock.at) > 0:
            self.clock.sleep(left * 1e-9)
        return self.answers.popleft()[1] if self.answers and self.answers[0][0] <= self.clock.at else self.empty

    def close(self) -> None:
        self.answers.clear()


class _ServiceLink(_Link):
    """`transport.websocket.WebSocket` of an emulated Inverse3."""

    def __init__(self, clock: VirtualTime, device: EmulatedInverse3) -> None:
        super().__init__(clock, "")
        self.device = device
        self.opened = self.answered = clock.at
        if device.days.is_unplugged(clock.at):
            raise DeviceError("no service: the emulated one is unplugged")
        self.answers.append((clock.at, device.report(clock.at, first=True)))

    def write(self, text: str) -> None:
        now = self.clock.at
        answer = self.device.answer(text, self.opened, now)
        if answer is None:
            raise DeviceError("the service has ended. Start it again.", lost=True)
        if answer:
            self.answered = self.device.due(now, self.answered)
            self.answers.append((self.answered, answer))


class _SensorLink(_Link):
    """`transport.udp.Udp` of an emulated Net F/T, which streams at 1 kHz from the first request on."""

    def __init__(self, clock: VirtualTime, sensor: netft.EmulatedSensor) -> None:
        super().__init__(clock, b"")
        self.sensor, self.next = sensor, 1 << 62

    def write(self, data: bytes) -> None:
        wanted = netft.REQUEST.unpack(data)[1] == netft.STREAM
        self.next = min(self.next, self.clock.at + MS) if wanted else 1 << 62

    def read(self, timeout: float) -> bytes:
        late = round(self.sensor.days.faults.latency * 1e9)
        while self.next <= self.clock.at + round(timeout * 1e9):
            if data := self.sensor.sample(self.next):
                self.answers.append((self.next + late, data))
            self.next += MS
        return super().read(timeout)


@dataclass
class Bench:
    """A driver with its emulator.

    applied  the command that the device applies now
    where    the true position [m] (3) of the grip; of a sensor its true wrench
    quantum  resolution of a command
    """

    driver: Any
    device: Any
    applied: Any
    where: Any
    quantum: float


def falcon(clock: VirtualTime, script: Script, faults: EmulatedFaults) -> Bench:
    device = EmulatedFalcon(script, faults, loaded=True, now=clock.now, sleep=clock.sleep)
    driver = FalconDriver(device.connect, clock=clock.now)
    return Bench(driver, device, lambda: device.torques, lambda: tuple(device.hand.position), 1e-4)


def rawhid(clock: VirtualTime, script: Script, faults: EmulatedFaults) -> Bench:
    device = EmulatedRawHid(script, faults)

    def applied() -> tuple[float, ...]:
        return device.force if clock.at < device.until else (0.0, 0.0, 0.0)

    return Bench(raw.RawHidDriver(device.connect), device, applied, lambda: tuple(device.hand.position), 1e-3)


def inverse3(clock: VirtualTime, script: Script, faults: EmulatedFaults) -> Bench:
    device = EmulatedInverse3(script, faults)
    driver = Inverse3Driver(lambda: _ServiceLink(clock, device))
    return Bench(driver, device, lambda: device.force, lambda: tuple(device.hand.position), 1e-9)


def sensor(clock: VirtualTime, script: Script, faults: EmulatedFaults) -> Bench:
    def wrench(now: int) -> tuple[float, ...]:
        t = (now - clock.begun) * 1e-9
        return tuple(math.sin(2.0 * math.pi * (1.0 + i) * t) for i in range(6))

    device = netft.EmulatedSensor(wrench, faults)
    driver = netft.NetFTDriver("nowhere")
    driver.connect = lambda: _SensorLink(clock, device)
    driver._page = lambda: b"<netft><cfgcpf>1000000</cfgcpf><cfgcpt>1000000</cfgcpt></netft>"
    return Bench(driver, device, tuple, lambda: wrench(clock.at), 0.0)


BENCHES = {
    "FalconDriver": falcon, "RawHidDriver": rawhid, "Inverse3Driver": inverse3, "NetFTDriver": sensor,
}  # fmt: skip
"""How to emulate each driver's device."""


@dataclass
class Record:
    """What happened.

    times [ns] (t), applied (t,3), places [m] (t,3)  at each moment at which the graph or the device did something
    wanted (t,3)   the newest command of the graph of numbers; NaN before the first
    given  [ns] (t)  its time
    pressed (t)    mask of the pressed buttons
    writes [ns]    times of the commands to the device
    samples        (time [ns], sample) of each step of the graph
    fault          the error that the graph got; None: none
    notes          of the exchange
    opened [ns]    times at which the device was opened
    """

    times: list[int] = field(default_factory=list)
    applied: list[tuple[float, ...]] = field(default_factory=list)
    places: list[tuple[float, ...]] = field(default_factory=list)
    wanted: list[tuple[float, ...]] = field(default_factory=list)
    given: list[int] = field(default_factory=list)
    pressed: list[int] = field(default_factory=list)
    writes: list[int] = field(default_factory=list)
    samples: list[tuple[int, DeviceSample]] = field(default_factory=list)
    fault: DeviceError | None = None
    notes: list[str] = field(default_factory=list)

    def arrays(self) -> tuple[np.ndarray, ...]:
        return np.array(self.times), np.array(self.applied), np.array(self.places), np.array(self.wanted)


def run(clock: VirtualTime, bench: Bench, guard: Guard, reconnect: bool, duration: float, command: Any, period: Any):
    """Run for a duration [s] and stop.

    command(t)  the command of the graph at t [s]; None: it gives none
    period(t)   time [ns] until the next step of the graph
    """
    exchange = Exchange(bench.driver, guard, reconnect=reconnect)
    exchange._stop = StopEvent(clock)
    record, newest = Record(), [((math.nan,) * bench.driver.size, 0)]

    def note() -> None:
        record.times.append(clock.at)
        record.applied.append(tuple(bench.applied()))
        record.places.append(bench.where())
        record.wanted.append(newest[0][0])
        record.given.append(newest[0][1])
        record.pressed.append(bench.device.hand.buttons if bench.driver.size else 0)

    def tick() -> int:
        note()
        try:
            sample = exchange.sample()
        except DeviceError as error:
            record.fault = error
            exchange.stop()
            return 1 << 62
        if sample is not None:
            record.samples.append((clock.at, sample))
        record.notes.extend(exchange.notes())
        if bench.driver.size and (given := command(clock.since())) is not None:
            exchange.command(given)
            if all(map(math.isfinite, given)):
                newest[0] = given, clock.at
        left = round((duration - clock.since()) * 1e9)
        if left <= 0:
            exchange._stop.set()
            return 1 << 62
        return min(period(clock.since()), left)

    cycle = bench.driver.cycle

    def cycled(sent: tuple[float, ...]) -> DeviceSample | None:
        record.writes.append(clock.at)
        answer = cycle(sent)
        note()
        return answer

    bench.driver.open()
    bench.driver.cycle = cycled
    clock.tick, clock.due = tick, clock.at
    exchange._run()
    note()
    if exchange._fault is not None and record.fault is None:
        record.fault = exchange._fault
    record.notes.extend(exchange.notes())
    return record
