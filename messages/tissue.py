"""Message of a deformable body."""

from __future__ import annotations

from typing import Annotated, Self

import msgspec
import numpy as np

from palpate.messages.base import Floats, Ints, Message, Vector, Vector3

NO_FLOATS = np.zeros(0)
NO_INTS = np.zeros(0, dtype="<i4")


class Surface(Message):
    """The deformed surface, and the terminal law: the body's response at the contact for the next step,

        F(s) = stiffness <s - free>^exponent <1 + damping (s - previous)/T>

    It speaks of the time `step` after that of the message; docs/equations/contact.md has what it says of other times.

    nodes         [1]     (k)    indices of displaced vertices of the sender's own mesh. The others rest or, where
                                 those listed lie all over the mesh, between them (nodes.base.surface.complete)
    displacement  [m]     (k,3)  of each
    pressure      [Pa]    (p)    contact pressure at each of `nodes`; empty where the model has none
    slipped       [1]     (q)    1 for each of `nodes` that slides; empty where the model does not know
    stiffness     [N/m^n] ()     K of the terminal law
    exponent      [1]     ()     n, in [1, 3]
    damping       [s/m]   ()     c
    free          [m]     ()     indentation of the next step at zero force
    previous      [m]     ()     indentation at the end of this step
    step          [s]     ()     time after that of the message that the law speaks of; 0: the contact's own step
    relaxation    [s]     ()     time constant with which the body comes to it; 0: at once, or as `damping` says
    clamped       [1]     ()     elements and vertices held at a limit, where the model has one; 0 where all is well
    slope         [N]     (3)    what the body's energy at this force gains for each metre that the contact moves along
                                 the surface; 0 where the model does not know. The finger is pushed that way
    turning       [1/m]   (t)    change of the outward normal with place, dn_i/dx_j row by row; t = 9, 0 without slope
    beyond        [1]     ()     how far beyond the range that the model was made from: 0 within, 1 at twice its end
    stored        [J]     (e)    energy that the body holds under the normal force; e = 1, 0 where the model does not
                                 tell or nobody reads it
    claimed       [1]     ()     error of the indentation at the force that a model of several fidelities owns to,
                                 relative to the finest of them; 0 for other models
    fidelity      [1]     ()     modes of the one in use; 0 for other models
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
    step: Annotated[float, "s"] = 0.0
    relaxation: Annotated[float, "s"] = 0.0
    clamped: Annotated[int, "1"] = 0
    slope: Annotated[Vector3, "N"] = (0.0, 0.0, 0.0)
    turning: Annotated[Vector, "1/m", ("t",)] = ()
    beyond: Annotated[float, "1"] = 0.0
    stored: Annotated[Vector, "J", ("e",)] = ()
    claimed: Annotated[float, "1"] = 0.0
    fidelity: Annotated[int, "1"] = 0

    @classmethod
    def example(cls, loaded: bool) -> Self:
        """A soft body that knows how it is curved."""
        made = super().example(loaded)
        law = {"stiffness": 3e3, "exponent": 1.5, "free": 0.0, "previous": 0.0}
        return msgspec.structs.replace(made, **law, turning=(0.0,) * 9)
