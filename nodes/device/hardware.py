"""Shared by all real devices: how they are found, limited, waited for, and emulated."""

from typing import Annotated, ClassVar

import msgspec

from palpate.drivers.emulate.hand import Script
from palpate.drivers.exchange import Driver
from palpate.drivers.guard import DeviceSample, Guard
from palpate.messages import DeviceState
from palpate.nodes.base.wired import Wired
from palpate.nodes.device.hand import SimulatedOperator


class Hardware(SimulatedOperator, Wired):
    """A device at the machine. Its commands pass the limits of `drivers/limits.py` last of all. Settings of all:

    deadman  mask of buttons of which one has to be held for any force; 0: none
    ramp     [s] in which the force comes in after start, homing or a break; none given: the device's own

    With `port: emulator`, `faults` makes bad days, and the hand goes the way of device.Simulated's settings.
    """

    paced: ClassVar[bool] = True

    deadman: Annotated[int, "1", msgspec.Meta(ge=0)] = 0
    ramp: Annotated[Annotated[float, msgspec.Meta(ge=0, le=60)] | None, "s"] = None

    def guard(self, driver: Driver) -> Guard:
        return Guard(driver.limits, self.deadman, self.ramp)

    def script(self) -> Script:
        return Script(
            points=tuple(map(tuple, self.points().tolist())),
            ends=tuple(self.ends().tolist()),
            shapes=tuple(self.shapes().tolist()),
            buttons=tuple(s.buttons for s in self.path),
            mass=self.mass,
            drag=self.damping,
            stiffness=self.hand_stiffness,
            damping=self.hand_damping,
        )


def state(sample: DeviceSample | None) -> DeviceState:
    """A sample as the graph knows it; neither angles nor place while they cannot be trusted."""
    if sample is None or not sample.homed:
        return DeviceState(buttons=0 if sample is None else sample.buttons, homed=False)
    if sample.joints:
        return DeviceState(joints=sample.joints, buttons=sample.buttons)
    return DeviceState(position=sample.position, buttons=sample.buttons)
