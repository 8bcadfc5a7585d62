"""A Falcon's grip in a simulated hand that follows a moving goal."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.records import floats, put, vector
from palpate.nodes.base import CompiledNode
from palpate.nodes.base.kernels import kernel
from palpate.nodes.device.hand import COUNTS, HELD_GRIP, HeldGrip, check_reach, geometry_of, hold_grip, move_grip
from palpate.physics.device.falcon import FALCON
from palpate.physics.device.falcon_statics import torque_kernel
from palpate.physics.device.grip import LINEAR


class Follower(HeldGrip, CompiledNode):
    """Settings of the hand, arm and grip of `device.Simulated` (docs/equations/controller.md), without its path.

    The node reports angles in whole encoder counts and the exact position. It accepts torques or a force. The grip
    stops at the limit of the legs' reach.
    """

    sink = True

    resolution: Annotated[float, "rad", msgspec.Meta(ge=0), COUNTS] = FALCON.count

    State = HELD_GRIP | {"goal": (3,)}
    """The goal of the hand [m], in the device's frame."""

    def start(self) -> None:
        super().start()
        here = check_reach(self, "begin", self.begin)
        hold_grip(self, np.zeros(1), np.array([here, here]), np.array([LINEAR], np.int32))
        self.own["goal"] = here


@kernel
def follow(own, goal, torque, force, out, dt):
    """Move the hand's goal at constant speed to `goal` [m] (3), in the device's frame, within the step of dt [s]."""
    torques = (0.0, 0.0, 0.0)
    if torque.there:
        torques = vector(torque.torques)
    elif force.there:
        f, at = force.force, own.motion.position
        _, t0, t1, t2 = torque_kernel(geometry_of(own.geometry), f[0], f[1], f[2], at[0], at[1], at[2])
        torques = (t0, t1, t2)
    points = floats(own.points)
    own.motion.time, own.motion.segment = 0.0, 0
    floats(own.ends)[0] = dt
    put(points[0], vector(own.goal))
    put(points[1], goal)
    joints = move_grip(own, torques, dt)
    put(own.goal, goal)
    out.joints.count = out.position.count = 3
    out.homed = True
    put(out.joints.values, joints)
    put(out.position.values, vector(own.motion.position))
