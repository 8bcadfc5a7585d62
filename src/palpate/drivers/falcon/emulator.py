"""Emulator of the Falcon: FTDI chip, boot loader, firmware, arms and the hand that holds it, byte for byte.

The chip sends a packet with two modem bytes, possibly empty, when 62 bytes have arrived from the line or its latency
timer has expired. Every byte takes ten bit times at the current baud rate.
"""

from __future__ import annotations

import random
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from palpate.drivers.emulate.faults import EmulatedFaults, FaultSchedule
from palpate.drivers.emulate.hand import EmulatedOperator, Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.falcon import NAME, firmware, frames
from palpate.drivers.transport import ftdi
from palpate.physics.device.falcon import FALCON, leg
from palpate.physics.device.falcon_statics import force_kernel

MODEM_BYTES = b"\x01\x60"
CLOCK = 3.0e6  # [Hz] of the chip's baud generator
OFFSET = (137, -411, 262)  # [counts] of the encoders before homing
IMAGE = random.Random(48).randbytes(9973)  # placeholder firmware, accepted only by the emulator


def baud(divisor: int) -> float:
    """Baud rate [1/s] of a divisor word: 14 integer bits, two bits for the fraction (0, 1/2, 1/4, 1/8)."""
    whole, part = divisor & 0x3FFF, (0.0, 0.5, 0.25, 0.125)[divisor >> 14 & 3]
    return CLOCK / (whole + part)


class EmulatedFalcon:
    """The device. It keeps its firmware, homing and hand when it is unplugged.

    script  path of the hand
    faults  its faults
    image   the firmware that it runs; any other can be loaded, but does not run
    loaded  whether its firmware is already loaded
    homing  [s] duration of homing
    waits   whether the hand starts with `hand.go`; otherwise when the device is homed
    now     clock [ns]
    sleep   waits [s]
    """

    def __init__(
        self,
        script: Script | None = None,
        faults: EmulatedFaults | None = None,
        image: bytes = IMAGE,
        *,
        loaded: bool = False,
        homing: float = 0.2,
        waits: bool = False,
        now: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.hand = EmulatedOperator(script or Script(), waits)
        self.days = FaultSchedule(faults or EmulatedFaults())
        self.image, self.homing = image, homing
        self.now, self.sleep = now, sleep
        self.running = loaded
        self.homed_at: int | None = None
        self.torques = (0.0, 0.0, 0.0)
        self.seen: deque[tuple[int, tuple[int, int, int]]] = deque(maxlen=4096)
        """The last 4096 motor words received, with their times [ns]."""
        self.lights = 0
        self.geometry = FALCON.geometry
        self.attempts = 0
        self._force(self.hand.position)

    def connect(self) -> EmulatedChip:
        """Open the chip. DeviceError: the device is unplugged."""
        if self.days.is_unplugged(self.now()):
            raise DeviceError(f"no {NAME} on USB: the emulated one is unplugged")
        return EmulatedChip(self)

    def answer(self, frame: bytes) -> bytes:
        """The answer of the running firmware to a frame."""
        now = self.now()
        if not self.hand.waits:
            self.days.begin(now)
        words, state = frames.numbers(frame[1:13]), frame[13] - frames.BASE
        self.seen.append((now, words))
        self.lights = state & 0xE
        if not state & frames.HOMING:
            self.homed_at = None
        elif self.homed_at is None:
            self.homed_at = now + round(self.homing * 1e9)
        homed = self.homed_at is not None and now >= self.homed_at
        if homed:
            self.hand.begin(now)
        place = self.hand.move(self._force, now)
        self.torques = frames.torques(words)
        if self.days.silent(now):
            return b""
        a, b, c = (self._count(i, place, homed) for i in range(3))
        if self.days.chance("glitches"):
            a += 1000
        return self.days.spoil(frames.report((a, b, c), self.hand.buttons, (homed,) * 3))

    def _force(self, place: np.ndarray) -> tuple[float, float, float]:
        _, x, y, z = force_kernel(self.geometry, *self.torques, *place)
        return x, y, z

    def _count(self, i: int, place: np.ndarray, homed: bool) -> int:
        angle = leg(self.geometry, i, *place)[1]
        count = round((angle - FALCON.zero) / FALCON.count) + (0 if homed else OFFSET[i])
        return count + (self.days.random.choice((-1, 1)) if self.days.chance("noise") else 0)


class EmulatedChip:
    """The FTDI chip of an emulated Falcon: `transport.ftdi.Ftdi`."""

    def __init__(self, device: EmulatedFalcon) -> None:
        self.device, self.opened = device, device.now()
        self.divisor, self.latency = firmware.SLOW, 0.016
        self.dtr = False
        self.loading: bytearray | None = None
        self.received = b""
        self.line: deque[tuple[int, int]] = deque()  # (time of arrival [ns], byte)
        self.free = 0  # [ns] time from which the line to the host is free
        self.timer = self.opened

    def control(self, request: int, value: int) -> None:
        self.device.days.check(NAME, self.opened, self.device.now())
        if request == ftdi.RESET and value == ftdi.PURGE_RX:
            self.line.clear()
        elif request == ftdi.RESET and value == ftdi.PURGE_TX:
            self.received = b""
        elif request == ftdi.LATENCY:
            self.latency = value * 1e-3
        elif request == ftdi.BAUD:
            self.divisor = value
            if value == firmware.RUNNING and self.loading is not None:
                self.device.running = bytes(self.loading) == self.device.image
                self.device.homed_at = None
                self.loading = None
        elif request == ftdi.MODEM and value in (ftdi.DTR_LOW, ftdi.DTR_HIGH):
            if value == ftdi.DTR_HIGH:  # resets the processor into its boot loader
                self.device.running, self.loading = False, None
            self.dtr = value == ftdi.DTR_HIGH

    def write(self, data: bytes) -> None:
        self.device.days.check(NAME, self.opened, self.device.now())
        device = self.device
        taken = round(10.0 / baud(self.divisor) * 1e9 * len(data))
        if self.divisor == firmware.SLOW and self.dtr:
            self.received = (self.received + data)[-3:]
            if self.received == firmware.HELLO:
                self.received = b""
                self._send(b"\x00" * (device.attempts % 2) + firmware.READY, taken)
        elif self.divisor == firmware.LOADING:
            self._load(data, taken)
        elif self.divisor == firmware.RUNNING and device.running:
            self.received += data
            while len(self.received) >= frames.LENGTH:
                frame, self.received = self.received[: frames.LENGTH], self.received[frames.LENGTH :]
                if frame[:1] == b"<" and frame[-1:] == b">":
                    self._send(device.answer(frame), taken + round(device.days.faults.latency * 1e9))

    def _load(self, data: bytes, taken: int) -> None:
        if self.loading is None:
            if data == firmware.LETTER:
                self.loading = bytearray()
                self.device.attempts += 1
                self._send(data, taken)
            return
        fails = self.device.attempts <= self.device.days.faults.flaky
        if fails and len(self.loading) >= 1000:
            data = bytes((data[0] ^ 0xFF,)) + data[1:]
        self.loading += data
        self._send(data, taken)

    def _send(self, data: bytes, after: int) -> None:
        step = round(10.0 / baud(self.divisor) * 1e9)
        at = max(self.device.now() + after, self.free)
        for byte in data:
            at += step
            self.line.append((at, byte))
        self.free = at

    def read(self, timeout: float) -> bytes:
        device = self.device
        deadline = device.now() + round(timeout * 1e9)
        period = round(self.latency * 1e9)
        self.timer = max(self.timer, device.now() - period)
        due = self.timer + period
        if len(self.line) >= ftdi.PACKET - 2:
            due = min(due, self.line[ftdi.PACKET - 3][0])
        left = min(due, deadline) - device.now()
        if left > 0:
            device.sleep(left * 1e-9)
        self.device.days.check(NAME, self.opened, self.device.now())
        if due > deadline:
            return b""
        self.timer = due
        packet = bytearray()
        while self.line and len(packet) < ftdi.PACKET - 2 and self.line[0][0] <= due:
            packet.append(self.line.popleft()[1])
        return MODEM_BYTES + bytes(packet)

    def close(self) -> None:
        self.line.clear()
