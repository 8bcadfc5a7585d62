"""Message of a force with its scatter."""

from typing import Annotated

from palpate.messages.base import Message, Vector


class ForceBand(Message):
    """The force at an indentation, and its scatter; all zero when apart.

    mean       [N] ()   mean of the normal law
    deviation  [N] ()   standard deviation of the normal law
    levels     [1] (q)  probabilities of the quantiles
    quantiles  [N] (q)  of the law cut off at zero force
    sample     [N] ()   one draw from the law cut off at zero force; 0 where none is asked for
    valid      [1] ()   false where the indentation is deeper than was measured: the law is then held at its last depth
    """

    mean: Annotated[float, "N"]
    deviation: Annotated[float, "N"]
    levels: Annotated[Vector, "1", ("q",)]
    quantiles: Annotated[Vector, "N", ("q",)]
    sample: Annotated[float, "N"]
    valid: Annotated[bool, "1"]
