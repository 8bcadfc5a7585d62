"""Message of a fingertip that knows which parts of its contact slide."""

from typing import Annotated

from palpate.messages.base import Floats, Ints, Message


class Slip(Message):
    """How far slip has come over the contact of a fingertip, and the same node by node.

    contacts   [1] ()     nodes that touch
    fraction   [1] ()     part of them that slides
    front      [m] ()     radius of a disc as large as what still sticks: the slip front comes in from the rim
    incipient  [1] ()     warning: enough of the contact slides to tell, and some still sticks
    gross      [1] ()     all of the contact slides
    state      [1] (n)    of each node of the pad: 0 apart, 1 sticks, 2 slides
    first      [s] (n)    of each, time of its first slip since the finger began to slide; -1 where there was none
    path       [m] (n)    of each, distance slipped since it touched: the localized displacement
    points     [m] (n,2)  of each, position in the plane of the plate, from the lowest point of the finger
    limited    [1] ()     beams at their strain limit
    deeper     [1] ()     pressed deeper than the pad was meshed for: rim beams are missing, the force is too small
    iterations [1] ()     of the solver
    residual   [1] ()     largest violation of the law of friction, over the largest friction of a node
    """

    contacts: Annotated[int, "1"]
    fraction: Annotated[float, "1"]
    front: Annotated[float, "m"]
    incipient: Annotated[bool, "1"]
    gross: Annotated[bool, "1"]
    state: Annotated[Ints, "1", ("n",)]
    first: Annotated[Floats, "s", ("n",)]
    path: Annotated[Floats, "m", ("n",)]
    points: Annotated[Floats, "m", ("n", 2)]
    limited: Annotated[int, "1"] = 0
    deeper: Annotated[bool, "1"] = False
    iterations: Annotated[int, "1"] = 0
    residual: Annotated[float, "1"] = 0.0
