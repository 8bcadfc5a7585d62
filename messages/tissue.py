"""Messages of a deformable body, and of its foundation."""

from typing import Annotated, Self

import msgspec
import numpy as np

from palpate.messages.base import NO_FLOATS, Floats, Ints, Sparse, Vector, Vector3, always_sent
from palpate.messages.fields import Bound

NO_INTS = np.zeros(0, dtype="<i4")
NO_LAWS, NO_SLOPES, NO_COUPLING = np.zeros((0, 5)), np.zeros((0, 12)), np.zeros((0, 0))
MOBILITY = Bound(1e6, "an organ of 1 mg m² that is free for 10 s")
NO_MOTION, NO_MOBILITY = np.zeros((0, 6)), np.zeros((0, 3))
for _empty in (NO_INTS, NO_LAWS, NO_SLOPES, NO_COUPLING, NO_MOTION, NO_MOBILITY):
    _empty.setflags(write=False)  # avoids a copy per message; all but the first are omitted on the wire by identity


class Surface(Sparse):
    """The deformed surface, and the terminal law: the body's response at the contact for the next step,

        F(s) = stiffness <s - rest_indentation>^exponent <1 + damping (s - previous_indentation)/T>

    It predicts the body at the time of the message plus `step`; for other times see docs/equations/contact.md.

    nodes                 [1]     (k)    indices of the displaced vertices of the sender's mesh. All others are at rest
                                         or, where the listed ones cover the whole mesh, interpolated between them
                                         (nodes.base.surface.complete)
    displacement          [m]     (k,3)  of each
    pressure              [Pa]    (p)    contact pressure at each of `nodes`; empty if the model does not compute it
    slipped               [1]     (q)    1 for each of `nodes` that slides; empty if the model does not compute it
    stiffness             [N/m^n] ()     K of the terminal law
    exponent              [1]     ()     n, in [1, 3]
    damping               [s/m]   ()     c
    rest_indentation      [m]     ()     indentation of the next step at zero force
    previous_indentation  [m]     ()     indentation at the end of this step
    step                  [s]     ()     length of the step for which the law is valid; 0: the step of the contact
    relaxation            [s]     ()     time constant with which the body approaches equilibrium; 0: instantly, or
                                         according to `damping`
    limited               [1]     ()     number of elements and vertices at a limit of the model; normally 0
    tangential_gradient   [N]     (3)    derivative of the body's complementary energy at this force by the position of
                                         the contact along the surface: the force that pushes the finger towards softer
                                         places. 0 if the model does not compute it
    shape_operator        [1/m]   (t)    dn_i/dx_j of the outward normal, row by row; t = 9, 0 without the gradient
    extrapolation         [1]     ()     distance outside the range that the model was built from: 0 within, 1 at twice
                                         its end
    stored                [J]     (e)    energy stored in the body by the normal force; e = 1, 0 if the model does not
                                         report it or no node reads it
    laws     [N/m^n, 1, s/m, m, m] (c,5) for several contacts: stiffness, exponent, damping, rest and previous
                                         indentation of each, in the order of the loads; the fields above are the first
    slopes         [N (3), 1/m (9)] (c,12) of each: tangential gradient and shape operator
    coupling              [1]     (c,c)  O_ij: force at contact i that would indent it as 1 N at contact j does

    With a single contact the last three are omitted on the wire.
    """

    nodes: Annotated[Ints, "1", ("k",)]
    displacement: Annotated[Floats, "m", ("k", 3)]
    stiffness: Annotated[float, "N/m^n"]
    exponent: Annotated[float, "1"]
    damping: Annotated[float, "s/m"]
    rest_indentation: Annotated[float, "m"]
    previous_indentation: Annotated[float, "m"]
    pressure: Annotated[Floats, "Pa", ("p",)] = always_sent(NO_FLOATS)
    slipped: Annotated[Ints, "1", ("q",)] = always_sent(NO_INTS)
    step: Annotated[float, "s"] = always_sent(0.0)
    relaxation: Annotated[float, "s"] = always_sent(0.0)
    limited: Annotated[int, "1"] = always_sent(0)
    tangential_gradient: Annotated[Vector3, "N"] = always_sent((0.0, 0.0, 0.0))
    shape_operator: Annotated[Vector, "1/m", ("t",)] = always_sent(())
    extrapolation: Annotated[float, "1"] = always_sent(0.0)
    stored: Annotated[Vector, "J", ("e",)] = always_sent(())
    laws: Annotated[Floats, "N/m^n, 1, s/m, m, m", ("c", 5)] = NO_LAWS
    slopes: Annotated[Floats, "N (3), 1/m (9)", ("c", 12)] = NO_SLOPES
    coupling: Annotated[Floats, "1", ("c", "c")] = NO_COUPLING

    @classmethod
    def example(cls, loaded: bool) -> Self:
        """A soft body with a shape operator."""
        made = super().example(loaded)
        law = {"stiffness": 3e3, "exponent": 1.5, "rest_indentation": 0.0, "previous_indentation": 0.0}
        several = {"laws": NO_LAWS, "slopes": NO_SLOPES, "coupling": NO_COUPLING}
        return msgspec.structs.replace(made, **law, **several, shape_operator=(0.0,) * 9)


class Support(Sparse):
    """Where the elastic foundation of an organ, or the organ on its foundation, is against its place at the start.

    displacement  [m]     (3)  of the foundation, or of the organ's centre
    velocity      [m/s]   (3)  mean velocity since the previous step
    rotation      [rad]   (r)  vector of the rotation about the centre; r = 3, or 0 if it does not rotate, and then the
                               last three are omitted on the wire
    spin          [rad/s] (r)  angular velocity
    centre        [m]     (r)  centre of the organ at the start

    Of an organ that forces move, for the contact with other organs; else (0,6), and omitted on the wire:

    expected  [m (3), rad (3)] (e,6)  displacement and rotation in the next step if all forces stay; e = 1
    mobility  [m/N (3), 1/(N m) (3)] (k,3)  the changes of displacement and of rotation, three rows each, per change of
                               the force and of the moment about the centre; k = 6
    """

    displacement: Annotated[Vector3, "m"]
    velocity: Annotated[Vector3, "m/s"]
    rotation: Annotated[Floats, "rad", ("r",)] = NO_FLOATS
    spin: Annotated[Floats, "rad/s", ("r",)] = NO_FLOATS
    centre: Annotated[Floats, "m", ("r",)] = NO_FLOATS
    expected: Annotated[Floats, "m (3), rad (3)", ("e", 6)] = NO_MOTION
    mobility: Annotated[Floats, "m/N (3), 1/(N m) (3)", ("k", 3), MOBILITY] = NO_MOBILITY
