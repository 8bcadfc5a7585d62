"""Message of a deformable body."""

from __future__ import annotations

from typing import Annotated, Self

import msgspec
import numpy as np

from palpate.messages.base import Floats, Ints, Message, Vector, Vector3

NO_FLOATS = np.zeros(0)
NO_INTS = np.zeros(0, dtype="<i4")
for _empty in (NO_FLOATS, NO_INTS):
    _empty.setflags(write=False)  # so that no message takes a copy


class Surface(Message):
    """The deformed surface, and the terminal law: the body's response at the contact for the next step,

        F(s) = stiffness <s - rest_indentation>^exponent <1 + damping (s - previous_indentation)/T>

    It speaks of the time `step` after that of the message; docs/equations/contact.md has what it says of other times.

    nodes                 [1]     (k)    indices of displaced vertices of the sender's own mesh. The others rest or,
                                         where those listed lie all over the mesh, between them
                                         (nodes.base.surface.complete)
    displacement          [m]     (k,3)  of each
    pressure              [Pa]    (p)    contact pressure at each of `nodes`; empty where the model has none
    slipped               [1]     (q)    1 for each of `nodes` that slides; empty where the model does not know
    stiffness             [N/m^n] ()     K of the terminal law
    exponent              [1]     ()     n, in [1, 3]
    damping               [s/m]   ()     c
    rest_indentation      [m]     ()     indentation of the next step at zero force
    previous_indentation  [m]     ()     indentation at the end of this step
    step                  [s]     ()     length of the step that the law holds for; 0: the contact's own step
    relaxation            [s]     ()     time constant with which the body approaches equilibrium; 0: at once, or as
                                         `damping` says
    limited               [1]     ()     elements and vertices held at a limit, where the model has one; normally 0
    tangential_gradient   [N]     (3)    derivative of the body's energy, at this force, with respect to the contact's
                                         position along the surface; 0 where the model does not know. It is the force
                                         that pushes the finger sideways
    shape_operator        [1/m]   (t)    dn_i/dx_j of the outward normal, row by row; t = 9, 0 without the gradient
    extrapolation         [1]     ()     how far outside the range that the model was built from: 0 within, 1 at twice
                                         its end
    stored                [J]     (e)    energy stored in the body by the normal force; e = 1, 0 where the model does
                                         not report it or nobody reads it
    estimated_error       [1]     ()     estimated error of the indentation, relative to the finest fidelity level; 0
                                         for models with one level
    fidelity              [1]     ()     modes of the level in use; 0 for other models
    """

    nodes: Annotated[Ints, "1", ("k",)]
    displacement: Annotated[Floats, "m", ("k", 3)]
    stiffness: Annotated[float, "N/m^n"]
    exponent: Annotated[float, "1"]
    damping: Annotated[float, "s/m"]
    rest_indentation: Annotated[float, "m"]
    previous_indentation: Annotated[float, "m"]
    pressure: Annotated[Floats, "Pa", ("p",)] = NO_FLOATS
    slipped: Annotated[Ints, "1", ("q",)] = NO_INTS
    step: Annotated[float, "s"] = 0.0
    relaxation: Annotated[float, "s"] = 0.0
    limited: Annotated[int, "1"] = 0
    tangential_gradient: Annotated[Vector3, "N"] = (0.0, 0.0, 0.0)
    shape_operator: Annotated[Vector, "1/m", ("t",)] = ()
    extrapolation: Annotated[float, "1"] = 0.0
    stored: Annotated[Vector, "J", ("e",)] = ()
    estimated_error: Annotated[float, "1"] = 0.0
    fidelity: Annotated[int, "1"] = 0

    @classmethod
    def example(cls, loaded: bool) -> Self:
        """A soft body that knows how it is curved."""
        made = super().example(loaded)
        law = {"stiffness": 3e3, "exponent": 1.5, "rest_indentation": 0.0, "previous_indentation": 0.0}
        return msgspec.structs.replace(made, **law, shape_operator=(0.0,) * 9)
