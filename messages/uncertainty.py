"""Message of a force with its scatter."""

from typing import Annotated

from palpate.messages.base import Message, Vector


class ForceBand(Message):
    """The force at an indentation, and its scatter; all zero when apart.

    mean       [N] ()   mean of the normal law
    deviation  [N] ()   standard deviation of the normal law
    levels     [1] (q)  probabilities of the quantiles
    quantiles  [N] (q)  of the law truncated at zero force
    sample     [N] ()   one draw from the law truncated at zero force; 0 if sampling is off
    valid      [1] ()   false if the indentation is deeper than was measured: the law of the deepest measurement is used
    """

    mean: Annotated[float, "N"]
    deviation: Annotated[float, "N"]
    levels: Annotated[Vector, "1", ("q",)]
    quantiles: Annotated[Vector, "N", ("q",)]
    sample: Annotated[float, "N"]
    valid: Annotated[bool, "1"]
