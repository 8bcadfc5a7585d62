"""Message of a fingertip that knows which parts of its contact slide."""

from __future__ import annotations

from typing import Annotated

from palpate.messages.base import Floats, Ints, Message


class Slip(Message):
    """How far slip has come over the contact of a fingertip, and the same node by node.

    contacts  [1]  ()     nodes that touch
    fraction  [1]  ()     part of them that slides
    front     [m]  ()     radius of a disc as large as what still sticks: the slip front comes in from the rim
    incipient [1]  ()     warning: part of the contact slides and part still sticks
    gross     [1]  ()     all of the contact slides
    first     [s]  (n)    time from first touch... to first slip of each node of the pad; -1 where it has not slipped
    path      [m]  (n)    slipped by each since it touched: the localized displacement
    nodes     [1]  (n)    0 apart, 1 sticks, 2 slides
    points    [m]  (n,2)  where each stands in the plane of the plate, from the point of first touch
    clamped   [1]  ()     beams that are pressed beyond their reach and held there
    rounds    [1]  ()     of the solver            residual [1] () violation of the law of friction, over the largest limit
    """

    contacts: Annotated[int, "1"]
    fraction: Annotated[float, "1"]
    front: Annotated[float, "m"]
    incipient: Annotated[bool, "1"]
    gross: Annotated[bool, "1"]
    first: Annotated[Floats, "s", ("n",)]
    path: Annotated[Floats, "m", ("n",)]
    nodes: Annotated[Ints, "1", ("n",)]
    points: Annotated[Floats, "m", ("n", 2)]
    clamped: Annotated[int, "1"]
    rounds: Annotated[int, "1"]
    residual: Annotated[float, "1"]
