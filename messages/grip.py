"""Message of several fingers that grip one body."""

from typing import Annotated

from palpate.messages.base import Message, Vector


class Grip(Message):
    """Grip of several fingers on one body: grip force, load force, and the safety margin of each finger against slip.

    grip        [N] ()   grip force: the part of the forces that cancels; negative if they pull the body apart
    load        [N] ()   load force: magnitude of the sum of the tangential forces, which friction carries
    ratio       [1] ()   load force over twice the grip force; slip begins at the friction coefficient; 0 without grip
    normal      [N] (c)  normal force of each finger, in the order of the graph
    tangential  [N] (c)  magnitude of the tangential force of each
    margin      [N] (c)  safety margin of each: normal force minus the least one that prevents slip
    """

    grip: Annotated[float, "N"]
    load: Annotated[float, "N"]
    ratio: Annotated[float, "1"]
    normal: Annotated[Vector, "N", ("c",)]
    tangential: Annotated[Vector, "N", ("c",)]
    margin: Annotated[Vector, "N", ("c",)]
