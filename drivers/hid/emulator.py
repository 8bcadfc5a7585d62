"""Emulators behind hidapi's interface: a raw-HID device with a hand that holds it, and a moving SpaceMouse."""

from __future__ import annotations

import math
import struct
import time
from collections import deque
from typing import ClassVar, Self

from palpate.drivers.emulate.faults import EmulatedFaults, FaultSchedule
from palpate.drivers.emulate.hand import EmulatedOperator, Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.hid import raw, spacemouse

COUNT = 20e-6  # [m] of the emulated device
UNIT = 1e-3  # [N]


class _EmulatedHid:
    """The connection of an emulated device: opened, unplugged and plugged in again."""

    name: ClassVar[str]

    def __init__(self, faults: EmulatedFaults | None) -> None:
        self.days = FaultSchedule(faults or EmulatedFaults())
        self.opened = time.monotonic_ns()

    def connect(self) -> Self:
        """Open the device. DeviceError: it is unplugged."""
        self.opened = time.monotonic_ns()
        if self.days.unplugged(self.opened):
            raise DeviceError(f"no {self.name} on USB: the emulated one is unplugged")
        return self

    def now(self) -> int:
        """The time [ns]. DeviceError: it was unplugged after it had been opened."""
        now = time.monotonic_ns()
        self.days.check(self.name, self.opened, now)
        return now


class EmulatedRawHid(_EmulatedHid):
    """A device with three axes that answers every command: `transport.hid.HidPort`. Its watchdog stops its motors."""

    name = raw.NAME

    def __init__(
        self, script: Script | None = None, faults: EmulatedFaults | None = None, *, waits: bool = False
    ) -> None:
        super().__init__(faults)
        self.hand = EmulatedOperator(script or Script(), waits)
        self.answers: deque[tuple[int, bytes]] = deque()
        """(time of arrival [ns], report)."""
        self.force = (0.0, 0.0, 0.0)
        self.until = 0  # [ns] when the watchdog switches the motors off
        self.sequence = 0

    def write(self, report: bytes) -> None:
        now = self.now()
        message = raw.unpack(report)
        if not isinstance(message, raw.RawCommand):
            return
        if not self.hand.waits:
            self.days.begin(now)
        self.hand.begin(now)
        force = self.force if now < self.until else (0.0, 0.0, 0.0)
        place = self.hand.move(lambda place: force, now)
        if message.flags & raw.ENABLE:
            x, y, z = (UNIT * v for v in message.values[:3])
            self.force, self.until = (x, y, z), now + message.watchdog * 1_000_000
        if self.days.silent(now):
            return
        answer: raw.RawState | raw.Info
        if message.flags & raw.ASK_INFO:
            answer = raw.Info(0, 3, (COUNT,) * 3 + (0.0,) * 3, (UNIT,) * 3 + (0.0,) * 3)
        else:
            self.sequence = self.sequence + 1 & 0xFFFF
            x, y, z = (round(p / COUNT) for p in place)
            counts = x + self.days.chance("noise"), y, z, 0, 0, 0
            stamp = now // 1000 & 0xFFFFFFFF
            answer = raw.RawState(self.sequence, message.sequence, raw.HOMED, 3, stamp, counts, self.hand.buttons)
        if data := self.days.spoil(raw.pack(answer)):
            self.answers.append((now + 1_000_000 + round(self.days.faults.latency * 1e9), data))

    def read(self, size: int, timeout: float) -> bytes:
        now = self.now()
        end = now + round(timeout * 1e9)
        due = self.answers[0][0] if self.answers else end + 1
        if (left := min(due, end) - now) > 0:
            time.sleep(left * 1e-9)
        return self.answers.popleft()[1][:size] if due <= end else b""

    def close(self) -> None:
        self.answers.clear()


class EmulatedSpaceMouse(_EmulatedHid):
    """A mouse that a hand presses down periodically: `transport.hid.HidPort`."""

    name = spacemouse.NAME
    PERIOD = 0.008  # [s] of its reports
    SWING = 2.0  # [s] of the hand

    def __init__(self, faults: EmulatedFaults | None = None) -> None:
        super().__init__(faults)
        self.due = self.begun = time.monotonic()

    def write(self, report: bytes) -> None:
        """It takes no reports."""

    def read(self, size: int, timeout: float) -> bytes:
        time.sleep(max(0.0, min(self.due - time.monotonic(), timeout)))
        self.days.begin(time.monotonic_ns())
        silent, now = self.days.silent(self.now()), time.monotonic()
        if silent or now < self.due:
            return b""
        self.due = now + self.PERIOD
        down = round(0.5 * spacemouse.FULL * math.sin(2 * math.pi * (now - self.begun) / self.SWING))
        return self.days.spoil(b"\x01" + struct.pack("<6h", 0, 0, down, 0, 0, 0))[:size]

    def close(self) -> None:
        """No-op."""
