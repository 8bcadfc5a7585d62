"""A six-axis force-torque sensor behind the fingertip (docs/equations/sensors.md)."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.records import floats, put, vector
from palpate.messages import Contact, Friction, Pose, Vector3
from palpate.messages.contact import Wrench
from palpate.nodes.base import TABLE, Out, Wants
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.surface import rotation_matrix
from palpate.nodes.sensor.sensing import Sensing, measure

Positive = msgspec.Meta(gt=0)


class ForceTorque(Sensing):
    """The force and torque that a sensor between hand and fingertip reports: contact, friction and the tool's weight.

    F = R' (f_n n + f_l - f_f + m g),   T = lever' x R' (f_n n + f_l - f_f) + centre x R' m g,   in the sensor's frame

    with the normal force f_n along n, the lateral force f_l of the contact and the friction f_f of the finger on the
    tissue; they act at the foot of the contact. The inertia of the tool is left out.

    orientation   rotation vector of the sensor's frame in the world (R)
    lever         from the sensor's origin to the fingertip of the pose, in the sensor's frame
    mass, centre  of the tool between sensor and fingertip; centre from the sensor's origin
    gravity       acceleration of free fall in the world
    force_range, torque_range   full scale of each axis, to which the shares of the imperfections refer
    """

    orientation: Annotated[Vector3, "rad"] = (0.0, 0.0, 0.0)
    lever: Annotated[Vector3, "m"] = (0.0, 0.0, -0.05)
    mass: Annotated[float, "kg", msgspec.Meta(ge=0, le=100)] = 0.0
    centre: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    gravity: Annotated[Vector3, "m/s^2"] = (0.0, 0.0, -9.81)
    force_range: Annotated[float, "N", Positive] = 50.0
    torque_range: Annotated[float, "N m", Positive] = 2.0

    State = Sensing.State | {"turn": TABLE}
    """Rotation matrix (3,3) from the world to the sensor."""

    def scale(self) -> np.ndarray:
        return np.repeat([self.force_range, self.torque_range], 3)

    def start(self) -> None:
        super().start()
        self.hold("turn", np.ascontiguousarray(rotation_matrix(self.orientation).T))

    @ieee_kernel
    def compute(
        own, contact: Annotated[Contact, Wants("foot", "normal", "force", "lateral_force")],
        pose: Annotated[Pose, Wants("position")], friction: Annotated[Friction | None, Wants("force")],
        out: Out[Wrench], dt,
    ):  # fmt: skip
        out.delayed = contact.delayed
        n, lateral, foot, at = contact.normal, contact.lateral_force, contact.foot, pose.position
        f, w = (0.0, 0.0, 0.0), own.mass
        if friction.there:
            f = vector(friction.force)
        press = contact.force
        load = (press * n[0] + lateral[0] - f[0], press * n[1] + lateral[1] - f[1], press * n[2] + lateral[2] - f[2])
        force = turn(own, load)
        weight = turn(own, (w * own.gravity[0], w * own.gravity[1], w * own.gravity[2]))
        aside = turn(own, (foot[0] - at[0], foot[1] - at[1], foot[2] - at[2]))
        arm = (own.lever[0] + aside[0], own.lever[1] + aside[1], own.lever[2] + aside[2])
        one, two = cross(arm, force), cross(vector(own.centre), weight)
        true = floats(own.true)
        for i in range(3):
            true[i] = force[i] + weight[i]
            true[3 + i] = one[i] + two[i]
        measure(own, dt)
        reported = floats(own.reported)
        put(out.force, (reported[0], reported[1], reported[2]))
        put(out.torque, (reported[3], reported[4], reported[5]))
        out.saturated = own.clipped


@ieee_kernel
def turn(own, v):
    """A vector of the world in the sensor's frame."""
    R = floats(own.turn)
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@ieee_kernel
def cross(a, b):
    """Cross product of two tuples."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
