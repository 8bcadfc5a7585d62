"""Message of a tactile shape display."""

from typing import Annotated

from palpate.messages.base import Floats, Message


class Pins(Message):
    """Command of a pin display: the shape on the fingerpad and the rigid-body motion below it.

    heights   [m] (rows,columns)  of the pins, positive towards the finger
    actuator  [m] ()              position of the linear actuator, positive away from the finger
    limited   [1] ()              true if a stroke limits the commanded surface
    valid     [1] ()              true while valid: from the force, if the contact radius is at most half
                                  the fingerpad's; from the tissue, if the surface or its pressure is available
    """

    heights: Annotated[Floats, "m", ("rows", "columns")]
    actuator: Annotated[float, "m"]
    limited: Annotated[bool, "1"]
    valid: Annotated[bool, "1"]
