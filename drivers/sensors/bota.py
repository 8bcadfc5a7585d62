"""Bota Systems' force-torque sensors with a serial port (SensONE, Rokubi, MiniONE).

As in the maker's open Python example: 460 800 baud; `C` for configuration, one command a line, `R` to run; each is
answered by `r,0,` and the command. Then frames: AA, 34 bytes, CRC-16/X-25 of these, all little-endian.
"""

import struct
import time
from collections.abc import Callable
from typing import NamedTuple

from palpate.drivers.checksums import crc16_x25
from palpate.drivers.connected import PortDriver, attempts
from palpate.drivers.emulate import EmulatedDevice
from palpate.drivers.errors import DeviceError
from palpate.drivers.framing import FrameReader
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import Limits
from palpate.drivers.transport.serial import SerialLine

NAME = "Bota force sensor"
BAUD = 460800
HEADER = b"\xaa"
BODY = struct.Struct("<H6fIf")  # status, forces [N] and torques [N m], time [us], temperature [deg C]
FRAME = 1 + BODY.size + 2
STEP = 19.53125e-6  # [s] of the sensor's converter: a frame comes every `sinc` steps
PATIENCE = 0.05  # [s] for a frame
SETUP = 2.0  # [s] for an answer while it is set up
INVALID = 0b0110  # bits of the status: out of range, invalid


class Reading(NamedTuple):
    """One frame. status [1], wrench [N] (3) and [N m] (3), time [us] of the sensor, temperature [deg C]."""

    status: int
    wrench: tuple[float, ...]
    time: int
    temperature: float


def frame(reading: Reading) -> bytes:
    body = BODY.pack(reading.status, *reading.wrench, reading.time, reading.temperature)
    return HEADER + body + struct.pack("<H", crc16_x25(body))


class BotaFrameReader(FrameReader[Reading]):
    """Finds the frames of the sensor."""

    head = HEADER

    def parse(self, data: bytes) -> tuple[Reading | None, int]:
        body, check = data[1 : 1 + BODY.size], data[1 + BODY.size : FRAME]
        if len(data) < FRAME or crc16_x25(body) != int.from_bytes(check, "little"):
            return None, FRAME
        status, *wrench, stamp, warmth = BODY.unpack(body)
        return Reading(status, tuple(wrench), stamp, warmth), FRAME


class Bota(PortDriver[SerialLine]):
    """The sensor behind a line.

    connect  opens the line
    sinc     length of its filter: 51 200 / sinc frames a second
    """

    name = NAME
    limits = Limits(0.0, 0.0, float("inf"))
    size = 0

    def __init__(self, connect: Callable[[], SerialLine], sinc: int = 57) -> None:
        super().__init__(connect)
        self.sinc = sinc

    def open(self) -> None:
        self.reader = BotaFrameReader()
        self.port = self.connect()
        self._ask("C")
        self._ask("c,0,1,0,4")  # no temperature compensation, calibrated, binary, 460 800 baud
        self._ask(f"f,{self.sinc},0,0,1")
        self._ask("R")

    def _ask(self, command: str) -> None:
        """One command and its answer; asked again while the sensor is still streaming frames or starting up."""
        answer, heard = f"r,0,{command[0]},0".encode(), b""
        for _ in attempts(SETUP):
            self.port.write(command.encode())
            pause = time.monotonic() + 0.25
            while time.monotonic() < pause:
                heard = (heard + self.port.read(0.05))[-4096:]
                runs = command == "R" and BotaFrameReader().feed(heard)  # frames say so, too
                if answer in heard or runs:
                    return
        what = "nothing" if not heard else f"{len(heard)} bytes without its answer"
        raise DeviceError(
            f"the {NAME} does not answer {command!r}: {what} came. Is this its port, and is the sensor under power?"
        )

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        deadline = time.monotonic() + PATIENCE
        while (left := deadline - time.monotonic()) > 0.0:
            readings = [r for r in self.reader.feed(self.port.read(left)) if not r.status & INVALID]
            if readings:
                return DeviceSample(time.monotonic_ns(), wrench=readings[-1].wrench)
        return None


class EmulatedBota(EmulatedDevice):
    """The sensor itself, for `emulate.line.EmulatedLine`. `wrench` tells what acts on it at a time [ns]."""

    def __init__(self, wrench: Callable[[int], tuple[float, ...]]) -> None:
        self.wrench = wrench
        self.running = False
        self.sinc = 512
        self.heard = b""
        self.started = False

    @property
    def period(self) -> float:
        return STEP * self.sinc

    def hear(self, data: bytes, now: int) -> list[bytes]:
        text = data.decode("ascii", errors="replace")
        if text == "C":
            self.running = False
        elif self.running:
            return []
        elif text.startswith("f,"):
            self.sinc = int(text.split(",")[1])
        elif text == "R":
            self.running = True
        elif not text.startswith("c,"):
            return []
        return [f"r,0,{text[0]},0,{text}\r\n".encode()]

    def say(self, now: int) -> bytes:
        if not self.running:
            said, self.started = b"" if self.started else b"Bota Systems AG\r\nApp Init\r\n", True
            return said
        return frame(Reading(0, self.wrench(now), now // 1000 & 0xFFFFFFFF, 30.0))
