"""A simulated device and the simulated hand that holds it."""

from collections import deque
from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.messages import DeviceState, Torque, Vector3
from palpate.nodes.base import SettingError
from palpate.nodes.base.absence import FALL, Faded, Pace
from palpate.nodes.device.hand import SimulatedOperator
from palpate.physics.device.falcon import FALCON, HOME, leg
from palpate.physics.device.grip import CLOCK, POSITION, grip_kernel
from palpate.physics.entry_point import entry_point

GLITCH = 1000 * FALCON.count  # [rad]


class Simulated(SimulatedOperator):
    """A Falcon held by a hand that follows a scripted path, with a compliant arm (docs/equations/controller.md).

    It reports what a real one would: driven angles in whole encoder counts. Torques work on the grip through the same
    geometry; where none come any more the last ones fall to zero within 4 ms. The weight is balanced. When its process
    has stood still, so have the hand and its script. Settings, with those of the hand:

    delay     samples by which reports are late; lost: chance that a report repeats the one before; glitches: chance
              that one angle is off by 1000 counts for one report. The same seed gives the same bad days
    """

    paced = True
    sink = True

    resolution: Annotated[float, "rad", msgspec.Meta(ge=0)] = FALCON.count
    delay: Annotated[int, "1", msgspec.Meta(ge=0, le=1000)] = 0
    lost: Annotated[float, "1", msgspec.Meta(ge=0, le=1)] = 0.0
    glitches: Annotated[float, "1", msgspec.Meta(ge=0, le=1)] = 0.0
    seed: Annotated[int, "1", msgspec.Meta(ge=0)] = 0

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self._reach("begin", self.begin)
        for i, segment in enumerate(self.path):
            if segment.to is not None:
                self._reach(f"path[{i}].to", segment.to)

    def _reach(self, name: str, point: Vector3) -> None:
        inside = tuple(p - o for p, o in zip(point, self.origin, strict=True))
        # Uncompiled: the compiler takes a quarter of a second to start, and the launcher needs nothing else of it.
        geometry = FALCON.geometry
        if not all(leg.py_func(geometry, i, *inside)[0] for i in range(3)):
            raise SettingError(
                f"setting {name!r} [m]: found {point}, {inside} from the device's origin, which is out of its reach. "
                f"Points near {HOME} from its origin work; 'origin' places the device in the world."
            )

    def start(self) -> None:
        self.geometry = FALCON.geometry
        self._way = (self.ends(), points := self.points(), self.shapes())
        self.state, self.memory = np.zeros((3, 3)), np.zeros((4, 3))
        self.state[POSITION] = points[0]
        self.random = np.random.Generator(np.random.PCG64(self.seed))
        self._torques, self._pace = Faded(FALL), Pace()
        self._fixed = (self.geometry, self.constants(self.resolution), self.state, self.memory, *self._way)
        self._grip = entry_point(grip_kernel, *self._fixed, 0.0, 0.0, 0.0, 0.0)
        first = self._move((0.0, 0.0, 0.0), 0.0)
        self.reports = deque([first] * (self.delay + 1), maxlen=self.delay + 1)
        self.last = first

    def _move(self, torques: Vector3, dt: float) -> tuple[float, float, float]:
        return self._grip(*self._fixed, *torques, dt)

    def step(self, torque: Torque | None, *, dt: float) -> DeviceState:
        if self._pace.update(dt):
            dt = self._pace.usual
        t0, t1, t2 = self.applied = self._torques.update(torque.torques if torque is not None else None, dt)
        self.reports.append(self._move((t0, t1, t2), dt))
        if not self.lost or self.random.random() >= self.lost:
            self.last = self.reports[0]
        joints = self.last
        if self.glitches and self.random.random() < self.glitches:
            joints = (joints[0] + GLITCH, joints[1], joints[2])
        return DeviceState(joints=joints, buttons=self.path[int(self.state[CLOCK, 1])].buttons if self.path else 0)
