"""One side of the contact of two bodies."""

from typing import Annotated, Literal

import numpy as np

from palpate.compiler.records import floats, integers, lend_first, put, vector
from palpate.messages import Load
from palpate.messages.contact import Neighbour, OrganContact
from palpate.messages.record import ROOM
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Out
from palpate.nodes.base.kernels import kernel
from palpate.nodes.base.surface import OnThinnedSurface

TOO_MANY = 1  # fault: more nodes than the surface has vertices, or more fingers than a body takes


class Side(CompiledNode, OnThinnedSurface):
    """The load of a `contact.Between` on one of its bodies, and what a finger on it feels of the other.

    Its surface is that of its body.
    """

    side: Annotated[Literal["first", "second"], "1"] = "first"

    State = {"nodes": ARRAY, "forces": TABLE, "yields": ARRAY}

    def start(self) -> None:
        super().start()
        size = len(self.mesh().vertices)
        self.hold("nodes", np.zeros(size, np.int32))
        self.hold("forces", np.zeros((size, 3)))
        self.hold("yields", np.zeros(ROOM * ROOM))

    @kernel
    def compute(own, contact: OrganContact, out: Out[Load], feels: Out[Neighbour], dt):
        second = own.side == 1
        given = contact.second_nodes if second else contact.first_nodes
        nodes, count = integers(given), given.shape[0]
        forces = floats(contact.second_forces if second else contact.first_forces)
        if count > own.nodes.shape[0]:
            own.fault = TOO_MANY
            return
        kept, pushes = integers(own.nodes), floats(own.forces)
        for k in range(count):
            kept[k] = nodes[k]
            for x in range(3):
                pushes[k, x] = forces[k, x]
        lend_first(out.nodes, own.nodes, count)
        lend_first(out.forces, own.forces, count)
        n, across = vector(contact.normal), floats(contact.across_normal)
        if second:
            put(out.foot, vector(contact.across))
            put(out.normal, vector(across) if len(across) == 3 else n)
        else:
            put(out.foot, vector(contact.foot))
            put(out.normal, (-n[0], -n[1], -n[2]))
        out.delayed = feels.delayed = contact.delayed
        feels.force = contact.force
        given, presses = (
            (contact.second_yields, contact.second_pressing)
            if second
            else (contact.first_yields, contact.first_pressing)
        )
        yields, lifts = floats(own.yields), floats(given)
        if given.shape[0] > ROOM or presses.count != given.shape[0]:
            own.fault = TOO_MANY
            return
        feels.pressing.count = presses.count
        for i in range(presses.count):
            feels.pressing.values[i] = presses.values[i]
            for j in range(presses.count):
                yields[i * presses.count + j] = lifts[i, j]
        feels.yields.address = own.yields.address
        feels.yields.shape[0] = feels.yields.shape[1] = presses.count
