"""Gamepads and joysticks: the axes and buttons of their report descriptor."""

import time
from typing import Any

from palpate.drivers.errors import DeviceError
from palpate.drivers.guard import DeviceSample
from palpate.drivers.hid.descriptor import AXES, BUTTON, DESKTOP, GAMEPADS, ReportField, fields
from palpate.drivers.hid.sender import HidSender
from palpate.drivers.limits import LIMITS

NAME = "gamepad"


def fits(entry: dict[str, Any]) -> bool:
    """Whether an entry of hidapi's list is a joystick or gamepad."""
    return entry.get("usage_page") == DESKTOP and entry.get("usage") in GAMEPADS


class Gamepad(HidSender):
    """A gamepad. `position` of its samples: the axes X, -Y, -Rz (or -Z) in -1 .. 1: left stick right and away, right
    stick up. `buttons`: the first 32."""

    limits = LIMITS["gamepad"]
    name = NAME

    def open(self) -> None:
        self.port = self.connect()
        inputs = fields(self.port.descriptor())
        self.numbered = any(f.report for f in inputs)
        self.axes: dict[int, ReportField] = {f.usage: f for f in reversed(inputs) if f.page == DESKTOP}
        self.keys = [f for f in inputs if f.page == BUTTON][:32]
        if AXES[0] not in self.axes or AXES[1] not in self.axes:
            raise DeviceError(
                f"the {NAME} describes no stick (axes X and Y). `palpate devices` shows what else is there."
            )
        self.values: dict[int, float] = {}
        self.buttons = 0

    def take(self, report: bytes) -> None:
        number, body = (report[0], report[1:]) if self.numbered and report else (0, report)
        for usage, field in self.axes.items():
            if field.report == number and (value := field.scaled(body)) is not None:
                self.values[usage] = value
        for i, field in enumerate(self.keys):
            if field.report == number and (pressed := field.value(body)) is not None:
                self.buttons = self.buttons | 1 << i if pressed else self.buttons & ~(1 << i)

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        self.listen()
        third = AXES[5] if AXES[5] in self.axes else AXES[2]
        x, y, z = (self.values.get(usage, 0.0) for usage in (AXES[0], AXES[1], third))
        return DeviceSample(time.monotonic_ns(), position=(x, -y, -z), buttons=self.buttons)
