"""Bodies that take several contacts beside those that take one."""

import numpy as np

from palpate.messages import Load, Surface
from palpate.nodes.base.compiled import TABLE, CompiledNode
from palpate.nodes.base.node import Node, inputs
from palpate.physics.kernel import kernel
from palpate.physics.records import floats, lend

SEVERAL = {"laws": TABLE, "slopes": TABLE, "coupling": TABLE}
"""What a body says of each of several contacts: see the fields of `Surface`."""


def make_room(body: CompiledNode, count: int) -> None:
    """Make room for so many contacts, which are nothing to each other."""
    body.hold("laws", np.zeros((count, 5)))
    body.hold("slopes", np.zeros((count, 12)))
    body.hold("coupling", np.eye(count))


@kernel
def send_laws(own, out):
    """Send what is known of each contact where there are several; the first one's law."""
    law = floats(own.laws)[0]
    out.stiffness, out.exponent, out.damping = law[0], law[1], law[2]
    out.rest_indentation, out.previous_indentation = law[3], law[4]
    if own.laws.shape[0] > 1:
        lend(out.laws, own.laws)
        lend(out.slopes, own.slopes)
        lend(out.coupling, own.coupling)


def press(body: Node, *loads: Load, dt: float) -> Surface:
    """A step of any body, called from code of one's own: most take several loads."""
    return body.step([*loads] if inputs(type(body))[0].many else loads[0], dt=dt)
