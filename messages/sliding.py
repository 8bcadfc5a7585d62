"""Message of the components of a sliding contact's force."""

from typing import Annotated

from palpate.messages.base import Message, Vector3


class Sliding(Message):
    """Contact force in the frame of the motion: normal to the surface, along the sliding direction, and across it.

    normal     [N]   ()   normal force f_n
    along      [N]   ()   friction of the finger on the surface along its sliding direction, f_f
    across     [N]   ()   friction across it, f_b; positive to the left of the motion, seen from outside
    speed      [m/s] ()   of the finger along the surface
    direction  [1]   (3)  of sliding, a unit vector in the plane of the surface; 0 until the finger has slid
    """

    normal: Annotated[float, "N"]
    along: Annotated[float, "N"]
    across: Annotated[float, "N"]
    speed: Annotated[float, "m/s"]
    direction: Annotated[Vector3, "1"]
