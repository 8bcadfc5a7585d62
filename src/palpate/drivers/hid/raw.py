"""The open raw-HID protocol for self-built haptic devices, specified in docs/raw_hid.md.

Reports of 64 bytes each way, without a report number, little-endian, CRC-16/X-25 of bytes 0 to 61 in the last two.
"""

import math
import struct
import time
from binascii import crc_hqx
from collections.abc import Sequence
from typing import Any, NamedTuple

from palpate.drivers.connected import PortDriver, attempts
from palpate.drivers.errors import DeviceError
from palpate.drivers.frame import FROZEN, LATE, SATURATED, FrameOrder, FrameRules, Measured, absent
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import LIMITS
from palpate.drivers.transport.burst import burst
from palpate.drivers.transport.hid import HidPort

NAME = "raw-HID device"
USAGE_PAGE, USAGE = 0xFFAB, 0x0200  # vendor-defined, of Teensy's Raw HID
MAGIC, VERSION = 0x50, 1
LENGTH, AXES = 64, 6
COMMAND, STATE, INFO = 1, 2, 3
ENABLE, HOME, ASK_INFO = 1, 2, 4  # flags of a command
HOMED, TRIPPED, FAULT = 1, 2, 4  # flags of a state
TORQUES = 1  # flag of an info: counts are of joints, commands are torques
PATIENCE = 0.004  # [s] timeout for a state
WATCHDOG = 20  # [ms] without a command after which the device switches its motors off
LARGEST_COUNT = (1 << 31) - 1
REPORTS = {
    "command": (COMMAND, (("sequence", "H", 1), ("flags", "B", 1), ("version", "B", 1), ("watchdog", "H", 1),
                          ("values", "h", AXES))),
    "state": (STATE, (("sequence", "H", 1), ("heard", "H", 1), ("flags", "B", 1), ("axes", "B", 1), ("time", "I", 1),
                      ("counts", "i", AXES), ("buttons", "H", 1))),
    "info": (INFO, (("version", "H", 1), ("flags", "B", 1), ("axes", "B", 1), ("per_count", "f", AXES),
                    ("per_unit", "f", AXES))),
}  # fmt: skip
"""The second byte of each report, and the fields from the third byte on: name, type as in `struct`, and number. The
page of `palpate build web` reads and writes reports by this table too."""


def _struct(name: str) -> struct.Struct:
    return struct.Struct("<BB" + "".join(f"{count}{code}" for _, code, count in REPORTS[name][1]))


_COMMAND, _STATE, _INFO = map(_struct, ("command", "state", "info"))
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))  # the bits of each byte in reverse order


class RawCommand(NamedTuple):
    """A message of the host: sequence number, flags, watchdog [ms], values (6) in the device's units."""

    sequence: int
    flags: int
    watchdog: int
    values: tuple[int, ...]


class RawState(NamedTuple):
    """A message of the device: its sequence number, that of the last command, flags, axes, time [us], counts (6),
    buttons."""

    sequence: int
    heard: int
    flags: int
    axes: int
    time: int
    counts: tuple[int, ...]
    buttons: int


class Info(NamedTuple):
    """Properties of the device: flags, axes, [m] or [rad] per count (6), [N] or [N m] per unit (6)."""

    flags: int
    axes: int
    per_count: tuple[float, ...]
    per_unit: tuple[float, ...]


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25: reflected polynomial 0x1021, initial value 0xFFFF, inverted. 0x906E for b"123456789"."""
    value = crc_hqx(data.translate(_REVERSED), 0xFFFF) ^ 0xFFFF
    return int.from_bytes(value.to_bytes(2, "big").translate(_REVERSED), "little")


def pack(message: RawCommand | RawState | Info) -> bytes:
    if isinstance(message, RawCommand):
        sequence, flags, watchdog, values = message
        body = _COMMAND.pack(MAGIC, COMMAND, sequence, flags, VERSION, watchdog, *values)
    elif isinstance(message, RawState):
        *head, counts, buttons = message
        body = _STATE.pack(MAGIC, STATE, *head, *counts, buttons)
    else:
        flags, axes, per_count, per_unit = message
        body = _INFO.pack(MAGIC, INFO, VERSION, flags, axes, *per_count, *per_unit)
    body = body.ljust(LENGTH - 2, b"\0")
    return body + crc16_x25(body).to_bytes(2, "little")


def unpack(report: bytes) -> RawCommand | RawState | Info | None:
    """The message in a report; None if it is invalid."""
    if len(report) != LENGTH or report[0] != MAGIC or crc16_x25(report[:-2]) != int.from_bytes(report[-2:], "little"):
        return None
    if report[1] == COMMAND:
        _, _, sequence, flags, _, watchdog, *values = _COMMAND.unpack_from(report)
        return RawCommand(sequence, flags, watchdog, tuple(values))
    if report[1] == STATE:
        _, _, sequence, heard, flags, axes, stamp, *rest = _STATE.unpack_from(report)
        return RawState(sequence, heard, flags, axes, stamp, tuple(rest[:AXES]), rest[AXES])
    if report[1] == INFO:
        _, _, _, flags, axes, *rest = _INFO.unpack_from(report)
        return Info(flags, axes, tuple(rest[:AXES]), tuple(rest[AXES:]))
    return None


def encode(values: Sequence[int], status: int = HOMED, number: int = 0, measured: int = 0) -> bytes:
    """A state: up to six counts, flags, its sequence number, and the time of the counts [us]."""
    return pack(RawState(number, 0, status, len(values), measured, (*values, *(0,) * (AXES - len(values))), 0))


def fits(entry: dict[str, Any]) -> bool:
    """Whether a device of hidapi's list may support the protocol; `open` then checks its answer."""
    return entry.get("usage_page") == USAGE_PAGE and entry.get("usage") == USAGE


class RawHidDriver(PortDriver[HidPort]):
    """A device with the protocol and up to three axes."""

    name = NAME
    limits = LIMITS["rawhid"]
    size = 3
    rules = FrameRules(
        ("m", "rad"), encode, {FAULT: "a fault"}, good=HOMED, homed=HOMED, numbers=1 << 16, measured=1 << 32,
        counts=(-LARGEST_COUNT, LARGEST_COUNT - 1),
    )  # fmt: skip

    def open(self) -> None:
        self.begin()
        self.port = self.connect()
        self.info = self._ask()
        axes = self.info.axes
        if not 1 <= axes <= 3:
            raise DeviceError(f"the {NAME} has {axes} axes, expected 1 to 3.")
        scales = (*self.info.per_count[:axes], *self.info.per_unit[:axes])
        if not all(math.isfinite(s) and s != 0.0 for s in scales):
            raise DeviceError(f"the {NAME} reports scales of {scales}, expected none to be 0: check its firmware.")

    def begin(self) -> None:
        """Accept any next number and time of the device."""
        self.sequence = 0
        self.order, self.measured = FrameOrder(self.rules), Measured()

    def _ask(self) -> Info:
        for _ in attempts(1.0):
            self._send(ASK_INFO, (0,) * AXES)
            for _ in range(8):
                answer = unpack(self.port.read(LENGTH, 0.01))
                if isinstance(answer, Info):
                    return answer
        raise DeviceError(f"the {NAME} does not answer as docs/raw_hid.md says. Is its firmware of version {VERSION}?")

    def _send(self, flags: int, values: tuple[int, ...]) -> None:
        self.sequence = self.sequence + 1 & 0xFFFF
        self.port.write(pack(RawCommand(self.sequence, flags, WATCHDOG, values)))

    def units(self, command: tuple[float, ...]) -> tuple[int, ...]:
        """A command [N] or [N m] in the device's units. A command outside its range is scaled as a whole."""
        raw = [c / u for c, u in zip(command[: self.info.axes], self.info.per_unit, strict=False)]
        scale = min(1.0, 32767.0 / max(max(map(abs, raw)), 1.0))
        return (*(round(scale * r) for r in raw), *(0,) * (AXES - len(raw)))

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        self._send(ENABLE | HOME, self.units(command))
        state = self._newest(time.monotonic() + PATIENCE)
        if state is None:
            return None
        now = time.monotonic_ns()
        at = self.measured.arrival(state.time, now)
        if state.flags & FAULT:
            raise DeviceError(f"the {NAME} reports a fault. Switch it off and on; check its firmware.")
        if not state.flags & HOMED:
            return absent(now, state.buttons)
        axes = self.info.axes
        why = SATURATED if self.rules.saturated(state.counts[:axes]) else FROZEN if self.measured.frozen(now) else ""
        if why:
            self.refused[why] += 1
            return absent(now, state.buttons)
        where = tuple(n * s for n, s in zip(state.counts[:axes], self.info.per_count, strict=False))
        where += (0.0,) * (3 - axes)
        if self.info.flags & TORQUES:
            return DeviceSample(at, joints=where, buttons=state.buttons)
        return DeviceSample(at, position=where, buttons=state.buttons)

    def _newest(self, deadline: float) -> RawState | None:
        """The newest state; None if none arrives before `deadline` [s]. Late and repeated ones are left out."""
        port, newest = self.port, None
        while newest is None and (left := deadline - time.monotonic()) > 0.0:
            for report in burst(lambda timeout: port.read(LENGTH, timeout), left):
                message = unpack(report)
                if not isinstance(message, RawState):
                    continue
                if self.order.take(message.sequence):
                    newest = message
                else:
                    self.refused[LATE] += 1
        return newest
