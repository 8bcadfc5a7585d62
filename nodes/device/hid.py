"""HID devices: haptic devices that speak the open raw-HID protocol."""

from palpate.drivers.exchange import Driver
from palpate.drivers.hid import raw
from palpate.drivers.transport.hid import UsbHid
from palpate.messages import DeviceState, Force, Torque
from palpate.nodes.base.wired import EMULATOR
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
