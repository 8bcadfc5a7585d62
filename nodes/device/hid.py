"""HID devices: haptic devices that speak the open raw-HID protocol, and 3Dconnexion's mice."""

from typing import Annotated, ClassVar, Literal

import msgspec

from palpate.drivers.exchange import Driver
from palpate.drivers.hid import raw, spacemouse
from palpate.drivers.transport.hid import UsbHid
from palpate.messages import DeviceState, Force, Torque, Vector3
from palpate.nodes.base.wired import EMULATOR, Wired
from palpate.nodes.device.hardware import Hardware, state


class RawHid(Hardware):
    """A haptic device with up to three axes that speaks the open protocol of docs/raw_hid.md, or its emulator.

    A device that measures positions takes `force`; one that measures joint angles takes `torque`.
    """

    def driver(self) -> Driver:
        if self.port == EMULATOR:
            from palpate.drivers.hid.emulator import EmulatedRawHid

            device = EmulatedRawHid(self.script(), self.faults, waits=True)
            self.go = device.hand.go
            return raw.RawHidDriver(device.connect)
        return raw.RawHidDriver(lambda: UsbHid(raw.fits, raw.NAME, self.port))

    def step(self, force: Force | None, torque: Torque | None, *, dt: float) -> DeviceState:
        if torque is not None:
            return state(self.talk(torque.torques, dt))
        return state(self.talk(force.force if force is not None else (0.0, 0.0, 0.0), dt))


class SpaceMouse(Wired):
    """A position that a 3Dconnexion mouse sets, without a force. With `port: emulator` it moves up and down.

    mode    "rate": the deflection is a velocity, `speed` at full deflection; "place": it is the distance from
            `begin`, `reach` at full deflection
    begin   the position at the start, in the device's frame
    low, high  corners of the box that limits the position
    """

    paced: ClassVar[bool] = True

    mode: Annotated[Literal["rate", "place"], "1"] = "rate"
    begin: Annotated[Vector3, "m"] = (0.0, 0.0, 0.116)
    speed: Annotated[float, "m/s", msgspec.Meta(gt=0, le=1)] = 0.05
    reach: Annotated[float, "m", msgspec.Meta(gt=0, le=1)] = 0.03
    low: Annotated[Vector3, "m"] = (-0.06, -0.06, 0.08)
    high: Annotated[Vector3, "m"] = (0.06, 0.06, 0.15)

    def start(self) -> None:
        self.point = self.begin
        super().start()

    def driver(self) -> Driver:
        if self.port == EMULATOR:
            from palpate.drivers.hid.emulator import EmulatedSpaceMouse

            return spacemouse.SpaceMouseDriver(EmulatedSpaceMouse(self.faults).connect)
        return spacemouse.SpaceMouseDriver(lambda: UsbHid(spacemouse.fits, spacemouse.NAME, self.port))

    def step(self, *, dt: float) -> DeviceState:
        sample = self.talk((), dt)
        if sample is None:
            return DeviceState(position=self.point)
        scale = self.reach if self.mode == "place" else self.speed * min(max(dt, 0.0), 0.1)
        origin = self.begin if self.mode == "place" else self.point
        x, y, z = (
            min(max(o + scale * a, low), high)
            for o, a, low, high in zip(origin, sample.position, self.low, self.high, strict=True)
        )
        self.point = x, y, z
        return DeviceState(position=self.point, buttons=sample.buttons)
