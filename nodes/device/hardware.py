"""Shared by all real devices: detection, limits, reconnection and emulation."""

from typing import Annotated, ClassVar

import msgspec

from palpate.drivers.emulate.hand import Script
from palpate.drivers.exchange import Driver
from palpate.drivers.guard import DeviceSample, Guard
from palpate.messages import DeviceState
from palpate.nodes.base.wired import Wired
from palpate.nodes.device.hand import SimulatedOperator


class Hardware(SimulatedOperator, Wired):
    """A device of this machine. The limits of `drivers/limits.py` are applied last to its commands. Common settings:

    deadman  mask of buttons of which one must be pressed for any force; 0: none
    ramp     [s] time in which the force ramps up after start, homing or an interruption; None: that of the device

    With `port: emulator`, `faults` sets simulated faults, and the hand follows the path of device.Simulated's settings.
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
    """The message for a sample; without angles and position while the device is not homed.

    While answers are missing, its age increases, so that the next one is not taken for a motion within one tick.
    """
    if sample is None or not sample.homed:
        return DeviceState(buttons=0 if sample is None else sample.buttons, homed=False)
    age = sample.age or msgspec.UNSET
    if sample.joints:
        return DeviceState(joints=sample.joints, buttons=sample.buttons, delayed=age)
    return DeviceState(position=sample.position, buttons=sample.buttons, delayed=age)
