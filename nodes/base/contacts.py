"""Shared by bodies that accept several contacts."""

from collections.abc import Sequence

import numpy as np

from palpate.compiler.records import floats, integers, lend, nth, vector
from palpate.messages import Load, Surface
from palpate.nodes.base.bone import WithBone
from palpate.nodes.base.compiled import TABLE, CompiledNode
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.node import Node, SettingError, inputs
from palpate.physics.bodies.mass_spring import normal_force

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


LEAST_PART = 1e-3  # [1] of a patch, below which the law is that of this part


@ieee_kernel
def spread_laws(own, load):
    """Turn the law of each contact, for its force F on this body, into that for the force F/w of the whole patch, of
    which the part w is on this body (`Contact.whole`): F = K s^n gives F/w = K/w s^n; and its couplings."""
    laws, coupling = floats(own.laws), floats(own.coupling)
    for i in range(load.count):
        each = nth(load, i)
        if each.whole.shape[0] == 0 or not floats(each.whole)[0] > 0.0:
            continue
        push = normal_force(floats(each.forces), vector(each.normal))
        part = min(max(push / floats(each.whole)[0], LEAST_PART), 1.0)
        laws[i, 0] /= part
        for j in range(load.count):
            if j != i:
                coupling[i, j] /= part


NO_VERTEX = 1  # fault: a load on an unknown vertex


@kernel
def unknown_vertex(load, count):
    """Whether a load is on a vertex that a surface of `count` vertices does not have: an index out of bounds, which
    would read and write other memory."""
    for i in range(load.count):
        for j in integers(nth(load, i).nodes):
            if not 0 <= j < count:
                return True
    return False


class MeshBody(CompiledNode, WithBone):
    """A body that takes loads on the vertices of its mesh, and has no fault but `NO_VERTEX`."""

    def explain(self, fault: int, *messages: Sequence[Load]) -> Exception:
        count = len(self.mesh().vertices)
        nodes = next(n for each in messages[0] if len(n := each.nodes) and not 0 <= n.min() <= n.max() < count)
        return SettingError(
            f"Load.nodes: found nodes {nodes.min()} ... {nodes.max()}, the surface has {count} vertices "
            f"({self.surface!r}); give the node that spreads the load the same surface"
        )


def press_body(body: Node, *loads: Load, dt: float) -> Surface:
    """A step of any body, called from scripts; most bodies take a list of loads."""
    return body.step([*loads] if inputs(type(body))[0].many else loads[0], dt=dt)
