"""Emulators behind hidapi's interface: a raw-HID device with a hand that holds it."""

from __future__ import annotations

import time
from collections import deque
from typing import Self

from palpate.drivers.emulate.faults import EmulatedFaults, FaultSchedule
from palpate.drivers.emulate.hand import EmulatedOperator, Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.hid import raw

COUNT = 20e-6  # [m] of the emulated device
UNIT = 1e-3  # [N]


class EmulatedRawHid:
    """A device with three axes that answers every command: `transport.hid.HidPort`. Its watchdog stops its motors."""

    def __init__(
        self, script: Script | None = None, faults: EmulatedFaults | None = None, *, waits: bool = False
    ) -> None:
        self.days = FaultSchedule(faults or EmulatedFaults())
        self.opened = time.monotonic_ns()
        self.hand = EmulatedOperator(script or Script(), waits)
        self.answers: deque[tuple[int, bytes]] = deque()
        """(time of arrival [ns], report)."""
        self.force = (0.0, 0.0, 0.0)
        self.until = 0  # [ns] when the watchdog switches the motors off
        self.sequence = 0

    def connect(self) -> Self:
        """Open the device. DeviceError: it is unplugged."""
        self.opened = time.monotonic_ns()
        if self.days.is_unplugged(self.opened):
            raise DeviceError(f"no {raw.NAME} on USB: the emulated one is unplugged")
        return self

    def now(self) -> int:
        """The time [ns]. DeviceError: it was unplugged after it had been opened."""
        now = time.monotonic_ns()
        self.days.check(raw.NAME, self.opened, now)
        return now

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
