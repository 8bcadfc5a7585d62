"""Message of fingers that hold one body between them."""

from typing import Annotated

from palpate.messages.base import Message, Vector


class Grip(Message):
    """How several fingers hold a body: what they press against each other, what they move it by, and how far each is
    from slipping.

    grip        [N] ()   grip force: the part of the forces that cancels; negative where they pull the body apart
    load        [N] ()   load force: size of the sum of the tangential forces, which friction carries
    ratio       [1] ()   load force over twice the grip force: it slips at the coefficient of friction; 0 without grip
    normal      [N] (c)  normal force of each finger, in the order of the graph
    tangential  [N] (c)  size of the tangential force of each
    margin      [N] (c)  safety margin of each: normal force less the least one that holds the tangential force
    """

    grip: Annotated[float, "N"]
    load: Annotated[float, "N"]
    ratio: Annotated[float, "1"]
    normal: Annotated[Vector, "N", ("c",)]
    tangential: Annotated[Vector, "N", ("c",)]
    margin: Annotated[Vector, "N", ("c",)]
