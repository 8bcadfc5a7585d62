"""Message of a texture under a sliding finger."""

from typing import Annotated

from palpate.messages.base import Floats, Message


class Vibration(Message):
    """Fluctuation of the force of a sliding contact, as a block of samples that ends with the tick.

    lateral   [N]   (n)  fluctuation about the friction law, along the sliding velocity of the finger; 0 without slip
    normal    [N]   (m)  fluctuation of the normal force; m = n, or 0 if the texture has none
    sampling  [Hz]  ()   of the samples
    speed     [m/s] ()   of sliding, in this tick
    """

    lateral: Annotated[Floats, "N", ("n",)]
    normal: Annotated[Floats, "N", ("m",)]
    sampling: Annotated[float, "Hz"]
    speed: Annotated[float, "m/s"]
