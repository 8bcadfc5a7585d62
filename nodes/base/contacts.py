"""Shared by bodies that accept several contacts."""

import numpy as np

from palpate.compiler.records import floats, lend
from palpate.messages import Load, Surface
from palpate.nodes.base.compiled import TABLE, CompiledNode
from palpate.nodes.base.kernels import kernel
from palpate.nodes.base.node import Node, inputs

SEVERAL = {"laws": TABLE, "slopes": TABLE, "coupling": TABLE}
"""The fields of `Surface` for several contacts."""


def make_room(body: CompiledNode, count: int) -> None:
    """Allocate the state for `count` contacts without coupling."""
    body.hold("laws", np.zeros((count, 5)))
    body.hold("slopes", np.zeros((count, 12)))
    body.hold("coupling", np.eye(count))


@kernel
def send_laws(own, out):
    """Send the law of the first contact and, with several contacts, the laws and couplings of all."""
    law = floats(own.laws)[0]
    out.stiffness, out.exponent, out.damping = law[0], law[1], law[2]
    out.rest_indentation, out.previous_indentation = law[3], law[4]
    if own.laws.shape[0] > 1:
        lend(out.laws, own.laws)
        lend(out.slopes, own.slopes)
        lend(out.coupling, own.coupling)


def press(body: Node, *loads: Load, dt: float) -> Surface:
    """A step of any body, called from scripts; most bodies take a list of loads."""
    return body.step([*loads] if inputs(type(body))[0].many else loads[0], dt=dt)
