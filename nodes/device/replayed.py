"""A device that repeats a recorded motion."""

from typing import Annotated

import msgspec

from palpate.messages import DeviceState, Force, Torque
from palpate.nodes.base import Node
from palpate.nodes.device.motion import read_motion
from palpate.nodes.device.recorded import recorded


class Replayed(Node):
    """A device with the states of a recording, one per tick, or of a table of a motion; then it stays at the last one.

    path    of the recording, or of a CSV with the columns `t` [s] and either `x`, `y`, `z` [m] or `joint1`, `joint2`,
            ... [rad], and optionally `buttons`; linear interpolation between rows. Other units are named in the
            header: `t [ms]`, `x [mm]`, `joint1 [deg]`
    stream  name of the stream of `DeviceState` in a recording
    repeat  start again at the end
    dialect  of the numbers of a CSV, decimal-comma or decimal-point, if the file leaves it open (1,234)

    In the truncated file of a killed run it stays at the last state. The clock is that of the graph. `palpate replay`
    uses the time stamps of the recording.
    """

    paced = True
    sink = True

    path: Annotated[str, "1"]
    stream: Annotated[str, "1"] = "device"
    repeat: Annotated[bool, "1"] = False
    dialect: Annotated[str, "1"] = ""

    def start(self) -> None:
        self.motion = read_motion(self.path, self.dialect) if self.path.lower().endswith(".csv") else None
        self.clock = 0.0
        if self.motion is not None:
            return
        self.states = recorded(self.path, self.stream, DeviceState)
        self.last = next(self.states)
        self.first = True

    def step(self, torque: Torque | None, force: Force | None, *, dt: float) -> DeviceState:
        if self.motion is not None:
            here, self.clock = self.motion.at(self.clock, self.repeat), self.clock + dt
            return here
        if not self.first:
            state = next(self.states, None)
            if state is None and self.repeat:
                self.states = recorded(self.path, self.stream, DeviceState)
                state = next(self.states, None)
            self.last = state or self.last
        self.first = False
        return msgspec.structs.replace(self.last)
