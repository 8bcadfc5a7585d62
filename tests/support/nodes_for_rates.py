"""An effect with a known output: an oscillating force."""

import math
import time
from typing import Annotated

from palpate.messages import Force, Pose
from palpate.nodes.base import Node


class Still(Node):
    """A pose at the origin at each tick."""

    paced = True

    def step(self, *, dt: float) -> Pose:
        return Pose(position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), dt=dt)


class Wave(Node):
    """A force that oscillates with the time of the pose."""

    effect = "display"
    frequency: Annotated[float, "Hz"] = 2.0
    amplitude: Annotated[float, "N"] = 3.0

    def step(self, pose: Pose) -> Force:
        turned = 2.0 * math.pi * self.frequency * pose.time * 1e-9
        return Force(force=(self.amplitude * math.sin(turned), 0.0, 0.0), state="free", energy=0.0)


class Waits(Node):
    """A force of 1 N that takes time without computing."""

    effect = "display"

    def step(self, pose: Pose) -> Force:
        time.sleep(4e-3)
        return Force(force=(1.0, 0.0, 0.0), state="free", energy=0.0)
