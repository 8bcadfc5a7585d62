"""Frames of a running Falcon: 16 bytes each way, `<`, 14 bytes, `>`.

Three signed 16-bit words of four nibbles each, the least significant first, every nibble sent as 0x41 + nibble; one
byte of state; one filler. To the device the words are motor commands, from it encoder counts. Bytes of words are in
0x41 .. 0x50, so they contain neither `<` nor `>`.
"""

import re
from typing import NamedTuple

LENGTH = 16
BASE = 0x41
LARGEST = 4096  # largest motor word
WORD_PER_TORQUE = -1.0e4  # [1/(N m)] empirical, of the open driver
HOMED = 0x70  # bits of the device's state byte: each encoder has passed its mark
HOMING, GREEN, BLUE, RED = 0x1, 0x2, 0x4, 0x8  # bits of the host's state byte


class FalconReport(NamedTuple):
    """A report of the device.

    counts   [1] (3)  encoders
    buttons  [1]      1 plus, 2 forward, 4 centre, 8 minus
    homed    [1] (3)  whether each encoder has passed its mark
    """

    counts: tuple[int, int, int]
    buttons: int
    homed: tuple[bool, bool, bool]


def words(values: tuple[int, int, int]) -> bytes:
    return bytes(BASE + (value >> shift & 0xF) for value in values for shift in (0, 4, 8, 12))


def numbers(data: bytes) -> tuple[int, int, int]:
    integers = []
    for i in (0, 4, 8):
        raw = sum((data[i + k] - BASE & 0xF) << 4 * k for k in range(4))
        integers.append(raw - 0x10000 if raw & 0x8000 else raw)
    return integers[0], integers[1], integers[2]


def command(motors: tuple[int, int, int], state: int = 0) -> bytes:
    """A frame to the device. `state`: HOMING and lights."""
    return b"<" + words(motors) + bytes((BASE + state, BASE)) + b">"


def report(counts: tuple[int, int, int], buttons: int, homed: tuple[bool, bool, bool]) -> bytes:
    state = buttons | sum(0x10 << i for i in range(3) if homed[i])
    return b"<" + words(counts) + bytes((BASE + state, BASE)) + b">"


def read(frame: bytes) -> FalconReport:
    state = frame[13] - BASE
    homed = bool(state & 0x10), bool(state & 0x20), bool(state & 0x40)
    return FalconReport(numbers(frame[1:13]), state & 0xF, homed)


def motors(torques: tuple[float, ...]) -> tuple[int, int, int]:
    """Motor words of three torques [N m]. If one exceeds the largest word, all three are scaled by the same factor."""
    raw = [WORD_PER_TORQUE * t for t in torques]
    scale = min(1.0, LARGEST / max(max(map(abs, raw)), 1.0))
    a, b, c = (round(scale * r) for r in raw)
    return a, b, c


def torques(values: tuple[int, int, int]) -> tuple[float, float, float]:
    """Torques [N m] of three motor words."""
    a, b, c = (v / WORD_PER_TORQUE for v in values)
    return a, b, c


_FRAME = re.compile(rb"<[\x41-\x50]{12}[\x41-\xc0].>", re.DOTALL)


class FalconFrameReader:
    """Finds the frames of a Falcon in a stream of bytes; resynchronises after an invalid one."""

    def __init__(self) -> None:
        self._rest = b""

    def clear(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Add bytes; returns the complete frames."""
        data, end, frames = self._rest + data, 0, []
        for match in _FRAME.finditer(data):
            frames.append(match[0])
            end = match.end()
        # The last bytes may begin a frame.
        begin = data.find(b"<", max(end, len(data) - LENGTH + 1))
        self._rest = data[begin:] if begin >= 0 else b""
        return frames
