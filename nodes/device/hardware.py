"""Shared by all real devices: how they are found, limited, waited for, and emulated."""

from __future__ import annotations

from typing import Annotated, ClassVar

import msgspec
import numpy as np

from palpate.drivers.emulate.hand import Script
from palpate.drivers.exchange import Driver
from palpate.drivers.guard import Guard, Sample
from palpate.messages import DeviceState, Vector3
from palpate.nodes.base.wired import Wired
from palpate.nodes.device.simulated import Segment
from palpate.physics.device.falcon import HOME
from palpate.physics.device.grip import LINEAR, MINIMUM_JERK


class Hardware(Wired):
    """A device at the machine. Its commands pass the limits of `drivers/limits.py` last of all. Settings of all:

    deadman  mask of buttons of which one has to be held for any force; 0: none
    ramp     [s] in which the force comes in after start, homing or a break; none given: the device's own

    With `port: emulator`, `faults` makes bad days, and the hand goes the way of device.Simulated's settings.
    """

    paced: ClassVar[bool] = True

    deadman: Annotated[int, "1", msgspec.Meta(ge=0)] = 0
    ramp: Annotated[Annotated[float, msgspec.Meta(ge=0, le=60)] | None, "s"] = None

    begin: Annotated[Vector3, "m"] = HOME
    path: Annotated[tuple[Segment, ...], "1"] = ()
    origin: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    mass: Annotated[float, "kg", msgspec.Meta(gt=0)] = 0.2
    damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.2
    hand_stiffness: Annotated[float, "N/m", msgspec.Meta(ge=0)] = 500.0
    hand_damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 10.0

    def guard(self, driver: Driver) -> Guard:
        return Guard(driver.limits, self.deadman, self.ramp)

    def script(self) -> Script:
        """The way of an emulated hand."""
        points, here = [self.begin], self.begin
        ox, oy, oz = self.origin
        for segment in self.path:
            here = segment.to or here
            points.append(here)
        return Script(
            points=tuple((x - ox, y - oy, z - oz) for x, y, z in points),
            ends=tuple(np.cumsum([s.duration for s in self.path], dtype=float).tolist()),
            shapes=tuple(LINEAR if s.shape == "linear" else MINIMUM_JERK for s in self.path),
            buttons=tuple(s.buttons for s in self.path),
            mass=self.mass,
            drag=self.damping,
            stiffness=self.hand_stiffness,
            damping=self.hand_damping,
        )


def state(sample: Sample | None) -> DeviceState:
    """A sample as the graph knows it; neither angles nor place while they cannot be trusted."""
    if sample is None or not sample.homed:
        return DeviceState(buttons=0 if sample is None else sample.buttons, homed=False)
    if sample.joints:
        return DeviceState(joints=sample.joints, buttons=sample.buttons)
    return DeviceState(position=sample.position, buttons=sample.buttons)
