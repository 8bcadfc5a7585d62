"""Messages of what force and tactile sensors report, imperfections included."""

from typing import Annotated

from palpate.messages.base import Floats, Message, Vector3
from palpate.messages.tactile import NO_VECTORS


class Wrench(Message):
    """What a six-axis force-torque sensor reports of the load on its tool side, in the frame of the sensor.

    force      [N]   (3)  force
    torque     [N m] (3)  torque about the sensor's origin
    saturated  [1]   ()   true if an axis is at the end of its range
    """

    force: Annotated[Vector3, "N"]
    torque: Annotated[Vector3, "N m"]
    saturated: Annotated[bool, "1"] = False


class TaxelForces(Message):
    """What the taxels of a fingertip report.

    positions  [m] (n,2)  of the taxels in the plane of the fingerpad, from its centre
    forces     [N] (n,3)  of each: two shear forces along the axes of the plane, and the normal force
    """

    positions: Annotated[Floats, "m", ("n", 2)] = NO_VECTORS[:, :2]
    forces: Annotated[Floats, "N", ("n", 3)] = NO_VECTORS
