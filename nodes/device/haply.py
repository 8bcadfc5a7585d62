"""Haply's devices."""

from dataclasses import replace
from typing import Annotated, Literal

import msgspec

from palpate.drivers.exchange import Driver
from palpate.drivers.haply import diy, inverse3
from palpate.drivers.transport.serial import SerialLine
from palpate.drivers.transport.websocket import WebSocket
from palpate.messages import DeviceState, Force, Vector3
from palpate.nodes.base.wired import EMULATOR
from palpate.nodes.device.hardware import Hardware, state

ZERO = (0.0, 0.0, 0.0)
PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


class Inverse3(Hardware):
    """A Haply Inverse3 through the manufacturer's local service, or its emulator (docs/devices.md).

    port       address of the service; empty: ws://localhost:10001
    device_id  which one, where the service has several
    """

    device_id: Annotated[str, "1"] = ""

    def driver(self) -> Driver:
        if self.port == EMULATOR:
            self.service = inverse3.EmulatedService(self.script(), self.faults, waits=True)
            self.go = self.service.hand.go
            return inverse3.Inverse3(lambda: WebSocket(self.service.address, inverse3.NAME))
        address = self.port or inverse3.ADDRESS
        return inverse3.Inverse3(lambda: WebSocket(address, inverse3.NAME), self.device_id)

    def stop(self) -> None:
        try:
            super().stop()
        finally:
            if hasattr(self, "service"):
                self.service.close()

    def step(self, force: Force | None, *, dt: float) -> DeviceState:
        return state(self.talk(force.force if force is not None else ZERO, dt))


class Haply2Diy(Hardware):
    """A planar Haply 2diy on a serial port, or its emulator (docs/devices.md).

    version  of the hardware: 2 of metal, 3 of plastic
    plane    which plane of the graph's frame it moves in: its x, and its y away from the motors
    centre   where the middle of its reach, 0.11 m from the motors, lies in the graph's frame
    """

    version: Annotated[Literal[2, 3], "1"] = 3
    plane: Annotated[Literal["xy", "xz", "yz"], "1"] = "xz"
    centre: Annotated[Vector3, "m"] = (0.0, 0.0, 0.116)
    mass: Annotated[float, "kg", msgspec.Meta(gt=0)] = 0.2

    def _middle(self) -> tuple[float, float]:
        return 0.5 * diy.BUILDS[self.version][0].apart, 0.11

    def driver(self) -> Driver:
        if self.port != EMULATOR:
            return diy.Haply2Diy(lambda: SerialLine(self.port, diy.BAUD, diy.NAME), self.version)
        from palpate.drivers.emulate.line import EmulatedLine

        made = self.script()
        (i, j), (u, v), centre = PLANES[self.plane], self._middle(), self.centre
        points = tuple((p[i] - centre[i] + u, p[j] - centre[j] + v, 0.0) for p in made.points)
        device = diy.Emulated2Diy(replace(made, points=points), self.version, waits=True)
        self.go = device.hand.go
        line = EmulatedLine(device, diy.BAUD, diy.NAME, self.faults)
        return diy.Haply2Diy(line.connect, self.version)

    def step(self, force: Force | None, *, dt: float) -> DeviceState:
        i, j = PLANES[self.plane]
        given = force.force if force is not None else ZERO
        sample = self.talk((given[i], given[j]), dt)
        if sample is None or not sample.homed:
            return state(sample)
        u, v = self._middle()
        where = list(self.centre)
        where[i] += sample.position[0] - u
        where[j] += sample.position[1] - v
        return DeviceState(position=(where[0], where[1], where[2]), buttons=sample.buttons)
