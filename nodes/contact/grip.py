"""Grip of several fingers on one body."""

import math
from typing import Annotated

import msgspec

from palpate.compiler.exact import hypot
from palpate.compiler.records import floats, nth
from palpate.messages import Friction, Load
from palpate.messages.grip import Grip as GripMessage
from palpate.messages.record import ROOM
from palpate.nodes.base import Agrees, CompiledNode, Out
from palpate.nodes.base.kernels import ieee_kernel
from palpate.physics.contact.grip import grip_force


class Grip(CompiledNode):
    """Grip force, load force and safety margins of up to 16 fingers on one body (docs/equations/contact.md).

    Each load is the force of one finger on the body at its foot point. A missing load counts as zero force.
    `mu_static` is the coefficient at which a sticking finger begins to slip, that of the friction law.
    """

    mu_static: Annotated[float, "1", msgspec.Meta(gt=0), Agrees(Load, Friction)] = 0.7

    State = {"foot": (ROOM, 3), "forces": (ROOM, 3), "one": (3,), "rubbed": (3,)}
    """Points [m] and forces [N] of the fingers that press; force of one [N]; sum along the surface [N]."""

    @ieee_kernel
    def compute(own, load: list[Load | None], out: Out[GripMessage], dt):
        force, rubbed, pressing = own.one, own.rubbed, 0
        rubbed[:] = 0.0
        for i in range(load.count):
            one = nth(load, i)
            there = one.there and one.nodes.shape[0] > 0
            force[:] = 0.0
            total = size = 0.0
            if there:
                forces = floats(one.forces)
                for k in range(len(forces)):
                    for axis in range(3):
                        force[axis] += forces[k, axis]
                for axis in range(3):
                    total += force[axis] * one.normal[axis]
            normal = -total
            for axis in range(3):
                along = force[axis] + normal * one.normal[axis] if there else 0.0
                size += along * along
                rubbed[axis] += along
            if normal > 0.0:
                for axis in range(3):
                    own.foot[pressing, axis], own.forces[pressing, axis] = one.foot[axis], force[axis]
                pressing += 1
            out.normal.values[i], out.tangential.values[i] = normal, math.sqrt(size)
            out.margin.values[i] = normal - math.sqrt(size) / own.mu_static
        out.normal.count = out.tangential.count = out.margin.count = load.count
        out.grip = grip_force(own.foot[:pressing], own.forces[:pressing]) if pressing > 0 else 0.0
        out.load = hypot(rubbed[0], rubbed[1], rubbed[2])
        out.ratio = out.load / (2.0 * out.grip) if out.grip > 0.0 else 0.0
