"""Message of a fingertip model that resolves stick and slip over its contact area."""

from typing import Annotated

from palpate.messages.base import Floats, Ints, Message
from palpate.messages.fields import Bound


class Slip(Message):
    """Progress of slip over the contact area of a fingertip, in total and node by node.

    contacts   [1] ()     number of nodes in contact
    fraction   [1] ()     fraction of them that slides
    front      [m] ()     radius of a disc with the area that still sticks: the slip front moves inwards from the rim
    incipient  [1] ()     warning of incipient slip: a detectable part of the contact slides, and some still sticks
    gross      [1] ()     gross slip: all of the contact slides
    state      [1] (n)    of each node of the pad: 0 apart, 1 sticks, 2 slides
    first      [s] (n)    of each, time of its first slip since the finger began to slide; -1 before that
    path       [m] (n)    of each, distance slipped since it touched: the localized displacement
    points     [m] (n,2)  of each, position in the plane of the plate, from the lowest point of the finger
    limited    [1] ()     number of beams at their strain limit
    deeper     [1] ()     pressed deeper than the pad was meshed for: rim beams are missing, the force is too small
    iterations [1] ()     number of iterations of the solver
    residual   [1] ()     largest violation of the friction law, over the largest friction limit of a node
    """

    contacts: Annotated[int, "1"]
    fraction: Annotated[float, "1", Bound(1.0, "a fraction")]
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
