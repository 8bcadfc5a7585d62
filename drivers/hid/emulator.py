"""HID devices at hidapi's seam: a raw-HID device with a hand that holds it, and a mouse or gamepad that is moved."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

import numpy as np

from palpate.drivers.emulate.faults import Days, EmulatedFaults
from palpate.drivers.emulate.hand import EmulatedOperator, Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.hid import raw, spacemouse

COUNT = 20e-6  # [m] of the emulated device
UNIT = 1e-3  # [N]
SWING = 2.0  # [s] of the hand at a mouse, the thumb at a gamepad


class EmulatedRawHid:
    """A device with three axes that answers every command, and stops without commands: `transport.hid.HidPort`."""

    def __init__(
        self, script: Script | None = None, faults: EmulatedFaults | None = None, *, waits: bool = False
    ) -> None:
        self.hand, self.days = EmulatedOperator(script or Script(), waits), Days(faults or EmulatedFaults())
        self.said: deque[tuple[int, bytes]] = deque()
        self.force = (0.0, 0.0, 0.0)
        self.until = 0
        self.opened = time.monotonic_ns()
        self.sequence = 0

    def connect(self) -> EmulatedRawHid:
        """Open the device. DeviceError: it is unplugged."""
        if self.days.unplugged(time.monotonic_ns()):
            raise DeviceError(f"no {raw.NAME} on USB: the emulated one is unplugged")
        self.opened = time.monotonic_ns()
        return self

    def write(self, report: bytes) -> None:
        self.days.check(raw.NAME, self.opened, time.monotonic_ns())
        message = raw.unpack(report)
        if not isinstance(message, raw.RawCommand):
            return
        now = time.monotonic_ns()
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
        self.sequence = self.sequence + 1 & 0xFFFF
        counts = [round(p / COUNT) for p in place]
        if self.days.chance("noise"):
            counts[0] += 1
        answer: raw.RawState | raw.Info
        if message.flags & raw.ASK_INFO:
            answer = raw.Info(0, 3, (COUNT,) * 3 + (0.0,) * 3, (UNIT,) * 3 + (0.0,) * 3)
        else:
            answer = raw.RawState(
                self.sequence, message.sequence, raw.HOMED, 3, now // 1000 & 0xFFFFFFFF, (*counts, 0, 0, 0),
                self.hand.buttons,
            )  # fmt: skip
        data = self.days.spoil(raw.pack(answer))
        if data:
            self.said.append((now + 1_000_000 + round(self.days.faults.latency * 1e9), data))

    def read(self, size: int, timeout: float) -> bytes:
        self.days.check(raw.NAME, self.opened, time.monotonic_ns())
        end = time.monotonic_ns() + round(timeout * 1e9)
        due = self.said[0][0] if self.said else end + 1
        left = min(due, end) - time.monotonic_ns()
        if left > 0:
            time.sleep(left * 1e-9)
        return self.said.popleft()[1][:size] if due <= end else b""

    def descriptor(self) -> bytes:
        return b""

    def close(self) -> None:
        self.said.clear()


class EmulatedReports:
    """A device that only reports, every 8 ms, what `moved` says at a time [s]: `transport.hid.HidPort`."""

    PERIOD = 0.008

    def __init__(
        self, moved: Callable[[float], list[bytes]], descriptor: bytes = b"", faults: EmulatedFaults | None = None
    ):
        self.moved, self.description, self.days = moved, descriptor, Days(faults or EmulatedFaults())
        self.said: deque[bytes] = deque()
        self.due = self.begun = time.monotonic()
        self.opened = time.monotonic_ns()

    def connect(self) -> EmulatedReports:
        """Open the device. DeviceError: it is unplugged."""
        if self.days.unplugged(time.monotonic_ns()):
            raise DeviceError("no such device on USB: the emulated one is unplugged")
        self.opened = time.monotonic_ns()
        return self

    def write(self, report: bytes) -> None:
        pass

    def read(self, size: int, timeout: float) -> bytes:
        end = time.monotonic() + timeout
        if not self.said:
            time.sleep(max(0.0, min(self.due, end) - time.monotonic()))
        now = time.monotonic()
        self.days.begin(time.monotonic_ns())
        self.days.check("device", self.opened, time.monotonic_ns())
        if now >= self.due and not self.days.silent(time.monotonic_ns()):
            self.due = now + self.PERIOD
            self.said += [spoilt for data in self.moved(now - self.begun) if (spoilt := self.days.spoil(data))]
        return self.said.popleft()[:size] if self.said else b""

    def descriptor(self) -> bytes:
        return self.description

    def close(self) -> None:
        self.said.clear()


def moving_mouse(at: float) -> list[bytes]:
    """A hand that presses a SpaceMouse down and lets it up again, once in `SWING`; `at` a time [s]."""
    down = round(175 * np.sin(2 * np.pi * at / SWING))
    return spacemouse.reports((0, 0, down, 0, 0, 0), 0, together=True)


GAMEPAD = bytes.fromhex(
    "05010905a101"  # generic desktop, gamepad, collection
    "8501"  # report 1
    "09300931093209351500 26ff00 75089504 8102"  # X Y Z Rz, 0 to 255, 8 bits each
    "05091901290c15002501 7501950c 8102"  # 12 buttons
    "75049501 8103"  # filler
    "c0"
)
"""Report descriptor of an ordinary gamepad: number, four bytes of sticks, twelve buttons."""


def moving_gamepad(at: float) -> list[bytes]:
    """A thumb that moves the left stick from side to side, once in `SWING`; `at` a time [s]."""
    x = round(127.5 + 100 * np.sin(2 * np.pi * at / SWING))
    return [bytes((1, x, 128, 128, 128, 0, 0))]
