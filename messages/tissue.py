"""Message of a deformable body."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from palpate.messages.base import Floats, Ints, Message

NO_FLOATS = np.zeros(0)
NO_INTS = np.zeros(0, dtype="<i4")


class Surface(Message):
    """The deformed surface, and the terminal law: the body's response at the contact for the next step,

        F(s) = stiffness <s - free>^exponent <1 + damping (s - previous)/T>

    nodes         [1]     (k)    indices of the displaced vertices, of the sender's own mesh
    displacement  [m]     (k,3)  of each
    pressure      [Pa]    (p)    contact pressure at each of `nodes`; empty where the model has none
    slipped       [1]     (q)    1 for each of `nodes` that slides; empty where the model does not know
    stiffness     [N/m^n] ()     K of the terminal law
    exponent      [1]     ()     n, in [1, 3]
    damping       [s/m]   ()     c
    free          [m]     ()     indentation of the next step at zero force
    previous      [m]     ()     indentation at the end of this step
    clamped       [1]     ()     elements held at the limit of their law, where the model has one; 0 where all is well
    """

    nodes: Annotated[Ints, "1", ("k",)]
    displacement: Annotated[Floats, "m", ("k", 3)]
    stiffness: Annotated[float, "N/m^n"]
    exponent: Annotated[float, "1"]
    damping: Annotated[float, "s/m"]
    free: Annotated[float, "m"]
    previous: Annotated[float, "m"]
    pressure: Annotated[Floats, "Pa", ("p",)] = NO_FLOATS
    slipped: Annotated[Ints, "1", ("q",)] = NO_INTS
    clamped: Annotated[int, "1"] = 0
