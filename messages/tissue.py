"""Message of a deformable body."""

from typing import Annotated, Any, Self

import msgspec
import numpy as np

from palpate.messages.base import Floats, Ints, Message, Vector, Vector3

NO_FLOATS = np.zeros(0)
NO_INTS = np.zeros(0, dtype="<i4")
NO_LAWS, NO_SLOPES, NO_COUPLING = np.zeros((0, 5)), np.zeros((0, 12)), np.zeros((0, 0))
for _empty in (NO_FLOATS, NO_INTS, NO_LAWS, NO_SLOPES, NO_COUPLING):
    _empty.setflags(write=False)  # so that no message takes a copy, and the last three stay left out on the wire


def sent(value: Any) -> Any:
    """A default that is sent all the same."""
    return msgspec.field(default_factory=lambda: value)


class _Sparse(Message, frozen=True, kw_only=True, omit_defaults=True):
    """A message whose plain defaults are left out on the wire; its header is not."""

    tick: Annotated[int, "1"] = sent(-1)
    time: Annotated[int, "ns"] = sent(-1)
    source: Annotated[str, "1"] = sent("")
    used: Annotated[tuple[int, ...], "1", ("u",)] = sent(())


class Surface(_Sparse):
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
    laws                  [SI]    (c,5)  where several contacts press: stiffness, exponent, damping, rest and previous
                                         indentation of each, in the order of the loads; the fields above have the first
    slopes                [SI]    (c,12) of each: tangential gradient [N] (3) and shape operator [1/m] (9)
    coupling              [1]     (c,c)  O_ij: force at contact i that would indent it as 1 N at contact j does

    The last three are left out on the wire where one contact presses.
    """

    nodes: Annotated[Ints, "1", ("k",)]
    displacement: Annotated[Floats, "m", ("k", 3)]
    stiffness: Annotated[float, "N/m^n"]
    exponent: Annotated[float, "1"]
    damping: Annotated[float, "s/m"]
    rest_indentation: Annotated[float, "m"]
    previous_indentation: Annotated[float, "m"]
    pressure: Annotated[Floats, "Pa", ("p",)] = sent(NO_FLOATS)
    slipped: Annotated[Ints, "1", ("q",)] = sent(NO_INTS)
    step: Annotated[float, "s"] = sent(0.0)
    relaxation: Annotated[float, "s"] = sent(0.0)
    limited: Annotated[int, "1"] = sent(0)
    tangential_gradient: Annotated[Vector3, "N"] = sent((0.0, 0.0, 0.0))
    shape_operator: Annotated[Vector, "1/m", ("t",)] = sent(())
    extrapolation: Annotated[float, "1"] = sent(0.0)
    stored: Annotated[Vector, "J", ("e",)] = sent(())
    laws: Annotated[Floats, "SI", ("c", 5)] = NO_LAWS
    slopes: Annotated[Floats, "SI", ("c", 12)] = NO_SLOPES
    coupling: Annotated[Floats, "1", ("c", "c")] = NO_COUPLING

    @classmethod
    def example(cls, loaded: bool) -> Self:
        """A soft body that knows how it is curved."""
        made = super().example(loaded)
        law = {"stiffness": 3e3, "exponent": 1.5, "rest_indentation": 0.0, "previous_indentation": 0.0}
        several = {"laws": NO_LAWS, "slopes": NO_SLOPES, "coupling": NO_COUPLING}
        return msgspec.structs.replace(made, **law, **several, shape_operator=(0.0,) * 9)
