"""The Novint Falcon."""

from typing import Annotated

from palpate.drivers.exchange import Driver
from palpate.drivers.falcon import NAME, PRODUCT, VENDOR, firmware
from palpate.drivers.falcon import driver as falcon
from palpate.drivers.transport.ftdi import UsbFtdi
from palpate.messages import DeviceState, Torque
from palpate.nodes.base.wired import EMULATOR
from palpate.nodes.device.hardware import Hardware, state

ZERO = (0.0, 0.0, 0.0)


class Falcon(Hardware):
    """A Novint Falcon on USB, or its emulator (docs/devices.md).

    firmware  file of the firmware image, loaded after each power-up; it is part of the manufacturer's driver

    Until it is homed (push the grip all the way in, then pull it out), it reports no angles and exerts no force.
    """

    firmware: Annotated[str, "1"] = ""

    def driver(self) -> Driver:
        if self.port == EMULATOR:
            from palpate.drivers.falcon.emulator import IMAGE, EmulatedFalcon

            device = EmulatedFalcon(self.script(), self.faults, waits=True)
            self.go = device.hand.go
            return falcon.FalconDriver(device.connect, lambda: IMAGE)
        image = (lambda: firmware.image(self.firmware)) if self.firmware else None
        return falcon.FalconDriver(lambda: UsbFtdi(VENDOR, PRODUCT, NAME, self.port), image)

    def step(self, torque: Torque | None, *, dt: float) -> DeviceState:
        return state(self.talk(torque.torques if torque is not None else ZERO, dt))
