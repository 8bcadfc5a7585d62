"""Message of the prescribed motion of organs."""

from typing import Annotated

from palpate.messages.base import Message, Vector3


class Support(Message):
    """Where the elastic foundation of an organ is, against its place at the start; the organ moves with it.

    displacement  [m]   (3)  of the foundation
    velocity      [m/s] (3)  mean velocity since the previous step
    """

    displacement: Annotated[Vector3, "m"]
    velocity: Annotated[Vector3, "m/s"]
