"""3Dconnexion's mice: six axes, no force.

Report 1 holds x y z as int16, low byte first, about -350 to 350; report 2 the rotations. Later models send all six in
report 1. Report 3 holds the buttons. In the graph's frame x points right, y away, z up, as in the open reader
PySpaceMouse: y and z of the device count the other way.
"""

from __future__ import annotations

import struct
import time
from typing import Any

from palpate.drivers.guard import DeviceSample
from palpate.drivers.hid.sender import HidSender
from palpate.drivers.limits import LIMITS

NAME = "SpaceMouse"
FULL = 350.0
SIGNS = (1.0, -1.0, -1.0, -1.0, -1.0, 1.0)
OLD = {0xC603, 0xC605, 0xC606, 0xC621, 0xC623, 0xC625, 0xC626, 0xC627, 0xC628, 0xC629, 0xC62B}
"""Products of Logitech's time, vendor 046D, which has many mice of the ordinary kind."""


def fits(entry: dict[str, Any]) -> bool:
    """Whether an entry of hidapi's list is one of them: any multi-axis controller of 256F, known products of 046D."""
    if entry["vendor_id"] == 0x256F:
        return entry.get("usage", 8) in (0, 8)
    return entry["vendor_id"] == 0x046D and entry["product_id"] in OLD


class SpaceMouse(HidSender):
    """The mouse. `position` of its samples: deflection [1] (3), about -1 to 1; `joints`: rotation [1] (3), likewise."""

    limits = LIMITS["spacemouse"]
    name = NAME

    def open(self) -> None:
        self.axes = [0.0] * 6
        self.buttons = 0
        self.port = self.connect()

    def take(self, report: bytes) -> None:
        """One report; what is none of the three, or cut off, is left out."""
        if len(report) >= 7 and report[0] in (1, 2):
            count = 6 if report[0] == 1 and len(report) >= 13 else 3
            first = 3 if report[0] == 2 else 0
            for i, raw in enumerate(struct.unpack_from(f"<{count}h", report, 1)):
                self.axes[first + i] = SIGNS[first + i] * min(max(raw / FULL, -1.5), 1.5)
        elif len(report) >= 2 and report[0] == 3:
            self.buttons = int.from_bytes(report[1:5], "little")

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        self.listen()
        return DeviceSample(time.monotonic_ns(), tuple(self.axes[3:]), tuple(self.axes[:3]), self.buttons)


def reports(axes: tuple[int, ...], buttons: int, together: bool) -> list[bytes]:
    """What a mouse sends for six raw axes and its buttons, on an old model or on one that sends all in one."""
    said = [b"\x01" + struct.pack("<6h", *axes)] if together else [
        b"\x01" + struct.pack("<3h", *axes[:3]), b"\x02" + struct.pack("<3h", *axes[3:])
    ]  # fmt: skip
    return [*said, b"\x03" + buttons.to_bytes(4, "little")]
