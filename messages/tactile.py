"""Message of what the skin feels beyond force."""

from __future__ import annotations

from typing import Annotated

from palpate.messages.base import Floats, Message
from palpate.messages.tissue import NO_FLOATS


class Tactile(Message):
    """Contact area, isostrain volumes and their growth with force.

    area          [m^2]   ()   contact area of the fingertip
    area_rate     [m^2/N] ()   its growth with the normal force
    levels        [1]    (l)  equivalent strains of the isostrain surfaces
    volumes       [m^3]   (l)  volume of the fingerpad strained at least that much
    volume_rates  [m^3/N] (l)  their growth with the normal force
    stick_radius  [m]    ()   radius inside which the contact sticks; the contact's own where nothing slides
    """

    area: Annotated[float, "m^2"] = 0.0
    area_rate: Annotated[float, "m^2/N"] = 0.0
    levels: Annotated[Floats, "1", ("l",)] = NO_FLOATS
    volumes: Annotated[Floats, "m^3", ("l",)] = NO_FLOATS
    volume_rates: Annotated[Floats, "m^3/N", ("l",)] = NO_FLOATS
    stick_radius: Annotated[float, "m"] = 0.0
