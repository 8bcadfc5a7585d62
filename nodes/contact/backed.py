"""Contact of a fingertip with a body that other bodies touch."""

from typing import Annotated, Any

import numpy as np

from palpate.compiler.records import floats
from palpate.messages import Contact, Proximity, Surface
from palpate.messages.contact import Neighbour
from palpate.nodes.base import TABLE, InputError, Out, Wants
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.samples import sample_of
from palpate.nodes.contact import finger
from palpate.nodes.contact.joint import law_for, slope_for
from palpate.nodes.contact.neighbours import add_neighbours
from palpate.nodes.contact.series import BAD_LAW, BODY, Series, touch
from palpate.physics.contact.organs.backed import backed_law

MISMATCH = 2  # fault: the number of the body's laws differs from that of its loads


@kernel
def _law(own, body, several, neighbour, dt):
    """The law under the finger, the first load of the body, with its neighbours, the other loads, in their order."""
    stiffness, exponent, damping, free, previous = law_for(body, several, 0)
    if not several:
        return stiffness, exponent, damping, free, previous
    others, yields, pressing = own.others, floats(own.yields), own.pressing
    add_neighbours(body, neighbour, 1, others, yields, pressing)
    step = body.step if body.step > 0.0 else dt
    return backed_law(stiffness, exponent, damping, free, previous, others[0], yields[0, 0], pressing[0], step)


class Backed(Series):
    """`Series` with a body that other bodies touch (docs/equations/between.md): the finger feels them in the same step.

    The finger's load is the first of the body; the others are those of the senders of `neighbour`, in the same order.
    Several fingers: `contact.Joint`.
    """

    shares_patch = False  # the organ below is pressed by the whole force
    State = Series.State | {"others": (1,), "yields": TABLE, "pressing": (1,)}

    def start(self) -> None:
        super().start()
        self.hold("yields", np.zeros((1, 1)))

    @kernel
    def idle(own, proximity, body, neighbour, out, dt):
        several = body.there and len(floats(body.laws)) > 1
        if several and len(floats(body.laws)) != neighbour.count + 1:
            return False
        law = _law(own, body, several, neighbour, dt)
        if not finger.at_rest(own.finger, proximity, body.there, law, body.step, body.relaxation):
            return False
        own.finger.sampled = sample_of(proximity)
        return True

    @ieee_kernel
    def compute(
        own,
        proximity: Proximity,
        body: Annotated[Surface | None, Wants(*BODY.names, "laws", "slopes", "coupling")],
        neighbour: list[Neighbour | None],
        out: Out[Contact],
        dt,
    ):
        several = body.there and len(floats(body.laws)) > 1
        if several and len(floats(body.laws)) != neighbour.count + 1:
            own.fault = MISMATCH
            return
        law = _law(own, body, several, neighbour, dt)
        if body.there and not finger.in_range(law, body.step, body.relaxation):
            own.fault = BAD_LAW
            return
        gradient, shape, sloped = slope_for(body, several, 0)
        touch(own, proximity, body, law, gradient, shape, sloped, out, dt)

    def explain(self, fault: int, *messages: Any) -> Exception:
        proximity, body, neighbours = messages
        if fault == MISMATCH:
            return InputError(
                body, f"found laws of {len(body.laws)} loads, expected {len(neighbours) + 1}: that of the finger, then "
                "one of each contact.Side of `neighbour`, in the same order"
            )  # fmt: skip
        return super().explain(fault, proximity, body)
