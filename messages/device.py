"""Messages between the haptic device and the hand side of the graph."""

from typing import Annotated

from palpate.messages.base import NO_FLOATS, Floats, Message, Sparse, Vector, Vector3
from palpate.messages.fields import OneOf


class DeviceState(Message):
    """State of a device, once per tick: joint angles, or position, or both, as the device measures them.

    joints    [rad] (j)  joint angles; empty if the device reports a position only
    position  [m]   (p)  position of the grip in the device frame; empty if the device reports joints only
    buttons   [1]   ()   bit mask of the pressed buttons
    homed     [1]   ()   true after homing: the joint angles are valid
    """

    joints: Annotated[Vector, "rad", ("j",)] = ()
    position: Annotated[Vector, "m", ("p",)] = ()
    buttons: Annotated[int, "1"] = 0
    homed: Annotated[bool, "1"] = True


class Pointed(Message):
    """Target position of the fingertip: the newest sample of a mouse, a pen or a finger on a touch screen.

    position  [m] (3)  target, world frame
    buttons   [1] ()   bit mask of the pressed buttons
    sample    [1] ()   sequence number that the sender gave the sample; 0 before the first
    """

    position: Annotated[Vector3, "m"]
    buttons: Annotated[int, "1"] = 0
    sample: Annotated[int, "1"] = 0


class Pose(Sparse):
    """The fingertip's bone edge in the world frame.

    position  [m]   (3)  position
    velocity  [m/s] (3)  filtered over measured time stamps
    dt        [s]   ()   time since the previous sample, measured
    behind    [m]   (b)  vector from the position to the place of the device, while the pose follows it after an outage;
                         b = 3, otherwise 0, and then the field is omitted on the wire
    """

    position: Annotated[Vector3, "m"]
    velocity: Annotated[Vector3, "m/s"]
    dt: Annotated[float, "s"]
    behind: Annotated[Floats, "m", ("b",)] = NO_FLOATS


class Force(Message):
    """The force that the controller commands.

    force   [N] (3)  on the hand, world frame
    state   [1] ()   "free" or "contact"
    energy  [J] ()   absorbed by the display since the last switch; negative if it has generated energy
    """

    force: Annotated[Vector3, "N"]
    state: Annotated[str, "1", OneOf("free", "contact")]
    energy: Annotated[float, "J"]


class Torque(Message):
    """Joint torques for the device.

    torques  [N m] (3)  one per leg
    """

    torques: Annotated[Vector3, "N m"]
