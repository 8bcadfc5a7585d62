"""Haply's Inverse3."""

from typing import Annotated

from palpate.drivers.exchange import Driver
from palpate.drivers.haply import inverse3
from palpate.drivers.transport.websocket import WebSocket
from palpate.messages import DeviceState, Force
from palpate.nodes.base.wired import EMULATOR
from palpate.nodes.device.hardware import Hardware, state

ZERO = (0.0, 0.0, 0.0)


class Inverse3(Hardware):
    """A Haply Inverse3 through the manufacturer's local service, or its emulator (docs/devices.md).

    port       address of the service; empty: ws://localhost:10001
    device_id  of the device, if the service has several
    """

    device_id: Annotated[str, "1"] = ""

    def driver(self) -> Driver:
        if self.port == EMULATOR:
            self.service = inverse3.EmulatedService(self.script(), self.faults, waits=True)
            self.go = self.service.hand.go
            return inverse3.Inverse3Driver(lambda: WebSocket(self.service.address, inverse3.NAME))
        address = self.port or inverse3.ADDRESS
        return inverse3.Inverse3Driver(lambda: WebSocket(address, inverse3.NAME), self.device_id)

    def stop(self) -> None:
        try:
            super().stop()
        finally:
            if hasattr(self, "service"):
                self.service.close()

    def step(self, force: Force | None, *, dt: float) -> DeviceState:
        return state(self.talk(force.force if force is not None else ZERO, dt))
