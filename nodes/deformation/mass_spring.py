"""The mass-spring body (docs/equations/mass-spring.md)."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Load, Surface
from palpate.nodes.base import ARRAY, CompiledNode, Out, Part, Switch
from palpate.nodes.base.contacts import SEVERAL, make_room, send_laws
from palpate.nodes.base.nodule import WithNodule
from palpate.physics.bodies.mass_spring import (
    AT_REST,
    NodalBody,
    deeper,
    mean_hardness,
    move,
    nodal_body,
    normal_force,
    retarded,
    shared,
    shifted,
)
from palpate.physics.contact.terminal import indentation
from palpate.physics.exact import row_times
from palpate.physics.kernel import kernel
from palpate.physics.records import floats, form, integers, lend_first, nth, one, unpacking, vector

NotNegative = msgspec.Meta(ge=0)

_body_of = unpacking(NodalBody)


class MassSpring(CompiledNode, WithNodule):
    """Nodes on springs and dampers in the zone of influence of the contact.

    The total normal force determines one indentation s by the law K <s + tau s'>^n <1 + c s'>. In an implicit step this
    is a terminal law, so contact and body together solve the same equations as a single solver. The nodal law
    determines the surface. Use n = 1 and tau for a solid under a patch of fixed width, n = 1.5 for a ball on a solid.

    Contacts with overlapping patches are coupled: F_i + sum_j O_ij F_j determines s_i, where O falls from 1 at distance
    0 to 0 at twice the patch radius. The displacement of the surface is the deepest of all contacts.
    """

    effect = "deformation"
    rank = 1

    stiffness: Annotated[float, "N/m^n", msgspec.Meta(gt=0)] = 3.0e3
    exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=3)] = 1.5
    damping: Annotated[float, "s/m", NotNegative, Switch("relaxation")] = 5.0
    retardation: Annotated[float, "s", NotNegative, Switch("relaxation")] = 0.0
    """Kelvin-Voigt: viscosity over modulus."""
    tangential_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 300.0
    tangential_damping: Annotated[float, "N s/m", NotNegative] = 3.0
    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 8e-3  # Of the patch under each of several fingers

    energy = Part(
        "energy", "stored",
        about="The energy of the law of the normal force, K s^(n+1)/(n+1), summed over the contacts.",
    )  # fmt: skip
    shape = Part(
        "shape", "nodes", "displacement",
        about="The displaced vertices of the surface and their displacement [m], under the forces of all contacts.",
    )  # fmt: skip
    State = SEVERAL | {"body": form(NodalBody), "hard": ARRAY, "forces": ARRAY, "acting": ARRAY, "factors": ARRAY}
    """The surface; factor on K of each vertex, with a nodule; of each contact: its normal force [N], that including the
    coupled ones, factor on K."""

    shared = "hard", "body.law", "body.nodal", "body.edges"

    _count = 1  # of contacts; kept over a start, so that their arrays exist before the first step

    def start(self) -> None:
        super().start()
        if self.area != "fixed":
            self._notes.append("MassSpring: its force law K s^n stays; scene.surface.area changes only its surface")
        self._hardness = self.hardness() if self.nodule_radius > 0.0 else None
        if self._hardness is not None:
            self.hold("hard", self._hardness)
        self._make(self._count)

    def resize(self, counts: list[int]) -> None:
        if counts[0] != self._count:
            self._make(counts[0])

    def _make(self, count: int) -> None:
        self._count = count
        make_room(self, count)
        self._held["laws"][:, :3] = self.stiffness, self.exponent, self.damping
        self.hold("factors", np.ones(count))
        self.hold("forces", np.zeros(count))
        self.hold("acting", np.zeros(count))
        if self.own["shape"]:
            law = (self.stiffness, self.exponent, self.damping, self.tangential_stiffness, self.tangential_damping)
            self.hold("body", nodal_body(self.mesh(), *law, self._hardness, count, self.retardation))

    @kernel
    def idle(own, load, out, dt):
        laws, counts = floats(own.laws), integers(own.body.counts)
        for i in range(load.count):
            if nth(load, i).nodes.shape[0] > 0 or laws[i, 4] != 0.0 or (own.shape and counts[i] > 0):
                return False
        return True

    @kernel(error_model="numpy")
    def compute(own, load: list[Load], out: Out[Surface], dt):
        # normal forces, and coupling of overlapping patches
        laws, coupling, forces, acting = floats(own.laws), floats(own.coupling), floats(own.forces), floats(own.acting)
        several = load.count > 1
        for i in range(load.count):
            each = nth(load, i)
            forces[i] = normal_force(floats(each.forces), vector(each.normal))
            for j in range(i + 1 if several else 0):
                other = nth(load, j)
                coupling[i, j] = shared(each.foot, other.foot, each.normal, other.normal, own.radius)
                coupling[j, i] = coupling[i, j]
        # indentation of each contact, and its terminal law for the next step
        stored, factors = 0.0, floats(own.factors)
        for i in range(load.count):
            each = nth(load, i)
            acting[i] = row_times(coupling[i], forces) if several else forces[i]
            if own.hard.shape[0] > 0 and each.nodes.shape[0] > 0:
                normal, hardness = vector(each.normal), floats(own.hard)
                factors[i] = mean_hardness(integers(each.nodes), floats(each.forces), normal, hardness)
            stiffness, previous = own.stiffness * factors[i], laws[i, 4]
            moving, rest = retarded(stiffness, own.exponent, own.retardation, dt)
            s = indentation(acting[i], dt, moving, own.exponent, own.damping, rest * previous, previous)
            if not acting[i] > 0.0 and s < AT_REST:
                s = 0.0
            laws[i, 0], laws[i, 3], laws[i, 4] = moving, rest * s, s
            if own.energy:
                grown = own.exponent + 1.0
                share = forces[i] / acting[i] if acting[i] > 0.0 else 1.0
                stored += share * (stiffness * max(s, 0.0) ** grown / grown)
        if own.energy:
            one(out.stored, stored)
        send_laws(own, out)
        out.step, out.relaxation = dt, own.retardation
        if not own.shape:
            return
        # displacement of the surface by the nodal law
        body, count = _body_of(own.body), 0
        for i in range(load.count):
            each = nth(load, i)
            pull, normal = floats(each.forces), vector(each.normal)
            share = forces[i] / acting[i] if acting[i] > 0.0 else 1.0
            if 0.0 < share < 1.0:
                pull = shifted(pull, normal, 1.0 / share - 1.0)
            count = move(body, i, integers(each.nodes), pull, normal, dt)
        if several:
            count = deeper(body)
            lend_first(out.nodes, own.body.nodes, count)
            lend_first(out.displacement, own.body.deepest, count)
        else:
            lend_first(out.nodes, own.body.active, count)
            lend_first(out.displacement, own.body.moved, count)
