"""One finger on several organs."""

from typing import Annotated

import numpy as np

from palpate.compiler.exact import hypot
from palpate.compiler.records import floats, lend_first, nth, put, vector
from palpate.messages import Contact, Friction
from palpate.nodes.base import ARRAY, CompiledNode, Out, Wants
from palpate.nodes.base.kernels import ieee_kernel


class Sum(CompiledNode):
    """Sum of the contacts and frictions of one finger on several organs.

    Each organ has a separate collision, contact, spread and body. If only one organ is touched, the contact is that of
    this organ. Otherwise force and normal are those of F = sum f_i n_i, the lengths are means weighted with f_i, the
    energies are added, and the foot is that of the greatest force. The organs touch each other only through a
    `contact.Between`.
    """

    State = {"total": (3,), "along": (3,), "lengths": (4,), "generated": ARRAY}  # sums over the organs

    def start(self) -> None:
        super().start()
        self.hold("generated", np.zeros(1))

    @ieee_kernel
    def compute(
        own,
        contact: list[Contact],
        friction: Annotated[list[Friction | None], Wants("force")],
        out: Out[Contact],
        rubbed: Out[Friction],
        dt,
    ):
        # Sum of the friction forces.
        put(rubbed.force, (0.0, 0.0, 0.0))
        for i in range(friction.count):
            rubbing = nth(friction, i)
            if rubbing.there:
                for axis in range(3):
                    rubbed.force[axis] += rubbing.force[axis]
        # Vector sums of the forces, and sums of depths and rates weighted with the normal force.
        total, along, lengths = own.total, own.along, own.lengths
        total[:], along[:], lengths[:] = 0.0, 0.0, 0.0
        whole, stored, pressing, most = 0.0, 0.0, 0, 0
        generated, known = 0.0, 0
        for i in range(contact.count):
            one = nth(contact, i)
            if one.generated.shape[0] > 0:
                generated, known = generated + floats(one.generated)[0], 1
            f = one.force
            if f > nth(contact, most).force:
                most = i
            pressing += f > 0.0
            whole += f
            for axis in range(3):
                total[axis] += f * one.normal[axis]
                along[axis] += one.lateral_force[axis]
            lengths[0] += f * one.compression
            lengths[1] += f * one.indentation
            lengths[2] += f * one.compression_rate
            lengths[3] += f * one.indentation_rate
            stored += one.stored.values[0] if one.stored.count > 0 else 0.0
        floats(own.generated)[0] = generated
        lend_first(out.generated, own.generated, known)
        # The contact with the largest force gives foot and normal; alone, it is the output.
        first = nth(contact, most)
        put(out.foot, vector(first.foot))
        put(out.normal, vector(first.normal))
        out.stored.count = first.stored.count
        if pressing < 2:
            out.force, out.stored.values[0] = first.force, first.stored.values[0]
            out.compression, out.indentation = first.compression, first.indentation
            out.compression_rate, out.indentation_rate = first.compression_rate, first.indentation_rate
            put(out.lateral_force, vector(first.lateral_force))
            return
        out.force, out.stored.values[0] = hypot(total[0], total[1], total[2]), stored
        if out.force > 0.0:
            put(out.normal, (total[0] / out.force, total[1] / out.force, total[2] / out.force))
        out.compression, out.indentation = lengths[0] / whole, lengths[1] / whole
        out.compression_rate, out.indentation_rate = lengths[2] / whole, lengths[3] / whole
        put(out.lateral_force, vector(along))
