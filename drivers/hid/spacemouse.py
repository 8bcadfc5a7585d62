"""3Dconnexion's SpaceMouse: six axes, no force.

Report 1 holds x y z as int16, low byte first, about -350 to 350; report 2 the rotations. Later models send all six in
report 1. Report 3 holds the buttons. In the graph's frame x points right, y away, z up, as in the open reader
PySpaceMouse: y and z of the device count in the opposite direction.
"""

import struct
import time
from typing import Any

from palpate.drivers.connected import PortDriver
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import LIMITS
from palpate.drivers.transport.burst import burst
from palpate.drivers.transport.hid import HidPort

NAME = "SpaceMouse"
PATIENCE = 0.02  # [s] for a report; an untouched mouse sends none
FULL = 350.0
SIGNS = (1.0, -1.0, -1.0, -1.0, -1.0, 1.0)
VENDOR, OLD_VENDOR = 0x256F, 0x046D
OLD = {0xC603, 0xC605, 0xC606, 0xC621, 0xC623, 0xC625, 0xC626, 0xC627, 0xC628, 0xC629, 0xC62B}
"""Products with the vendor number of Logitech, which has many ordinary mice."""


def fits(entry: dict[str, Any]) -> bool:
    """Whether an entry of hidapi's list is one: any multi-axis controller of 3Dconnexion, the old ones of Logitech."""
    if entry["vendor_id"] == VENDOR:
        return entry.get("usage", 8) in (0, 8)
    return entry["vendor_id"] == OLD_VENDOR and entry["product_id"] in OLD


class SpaceMouseDriver(PortDriver[HidPort]):
    """The mouse. `position` of its samples: deflection [1] (3), about -1 to 1; `joints`: rotation [1] (3), likewise."""

    name = NAME
    limits = LIMITS["spacemouse"]
    size = 0

    def open(self) -> None:
        self.axes = [0.0] * 6
        self.buttons = 0
        self.port = self.connect()

    def take(self, report: bytes) -> None:
        """Apply one report; ignore unknown and truncated ones."""
        if len(report) >= 7 and report[0] in (1, 2):
            count = 6 if report[0] == 1 and len(report) >= 13 else 3
            first = 3 if report[0] == 2 else 0
            for i, raw in enumerate(struct.unpack_from(f"<{count}h", report, 1)):
                self.axes[first + i] = SIGNS[first + i] * min(max(raw / FULL, -1.5), 1.5)
        elif len(report) >= 2 and report[0] == 3:
            self.buttons = int.from_bytes(report[1:5], "little")

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        port = self.port
        for report in burst(lambda timeout: port.read(64, timeout), PATIENCE):
            self.take(report)
        return DeviceSample(time.monotonic_ns(), tuple(self.axes[3:]), tuple(self.axes[:3]), self.buttons)
