"""A Falcon's grip in a simulated hand that follows a moving goal, whoever sets it."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import DeviceState, Force, Torque
from palpate.nodes.base import SettingError
from palpate.nodes.device.hand import HeldGrip
from palpate.physics.device.falcon import FALCON, HOME, reachable
from palpate.physics.device.falcon_statics import torque_kernel
from palpate.physics.device.grip import CLOCK, LINEAR, POSITION, grip_kernel
from palpate.physics.entry_point import entry_point

ZERO = (0.0, 0.0, 0.0)


class Follower(HeldGrip):
    """Settings of the hand, arm and grip of `device.Simulated` (docs/equations/controller.md), without its path.

    The node reports both angles, in whole encoder counts, and the exact position. It takes what the graph sends,
    torques or a force. Beyond the reach of the legs the grip stops.
    """

    sink = True

    resolution: Annotated[float, "rad", msgspec.Meta(ge=0)] = FALCON.count

    def start(self) -> None:
        self.geometry = FALCON.geometry
        here = np.array(self.begin) - np.array(self.origin)
        if not reachable(self.geometry, *here):
            raise SettingError(
                f"setting 'begin' [m]: found {self.begin}, {tuple(here.tolist())} from the device's origin, out of its "
                f"reach. Points near {HOME} from its origin work; 'origin' places the device in the world."
            )
        self.state, self.memory = np.zeros((3, 3)), np.zeros((4, 3))
        self.state[POSITION] = here
        self.goal = here
        self._end, self._points = np.zeros(1), np.array([here, here])
        self._fixed = (self.geometry, self.constants(self.resolution), self.state, self.memory, self._end, self._points)
        self._shapes = np.array([LINEAR])
        self._move = entry_point(grip_kernel, *self._fixed, self._shapes, 0.0, 0.0, 0.0, 0.0)

    def follow(
        self, goal: np.ndarray, torque: Torque | None, force: Force | None, buttons: int, dt: float
    ) -> DeviceState:
        """Let the hand's goal go evenly to `goal` [m] (3), in the device's own frame, within the step of dt [s]."""
        torques = ZERO
        if torque is not None:
            torques = torque.torques
        elif force is not None:
            torques = torque_kernel(self.geometry, *force.force, *self.state[POSITION])[-3:]
        self.state[CLOCK] = 0.0
        self._end[0] = dt
        self._points[0], self._points[1] = self.goal, goal
        joints = self._move(*self._fixed, self._shapes, *torques, dt)
        self.goal = goal
        x, y, z = self.state[POSITION].tolist()
        return DeviceState(joints=joints, position=(x, y, z), buttons=buttons)
