"""A nearly rigid plate."""

from typing import Annotated, ClassVar

import msgspec
import numpy as np

from palpate.compiler.records import floats, nth, one, vector
from palpate.messages import Load, Surface
from palpate.nodes.base import CompiledNode, Out
from palpate.nodes.base.contacts import SEVERAL, make_room, send_laws, spread_laws
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.samples import oldest
from palpate.physics.bodies.between_bodies import NO_TANGENTS, BetweenBody, rigid_between
from palpate.physics.bodies.mass_spring import normal_force
from palpate.physics.contact.organs.candidates import Shares


class Rigid(CompiledNode):
    """A plate that is indented by force/stiffness, 10 nm at 10 N unless set otherwise, and sends no displacement: for
    scenes without tissue, and to see the fingertip alone. Several contacts do not feel one another."""

    couples: ClassVar[bool] = False
    """Whether a finger moves the surface under another one, which other bodies do."""
    plate_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 1e9

    State = SEVERAL

    def resize(self, counts: list[int]) -> None:
        make_room(self, counts[0])

    def between(
        self,
        size: int,
        shares: Shares,
        normal: np.ndarray,
        area: np.ndarray,
        tangents: np.ndarray = NO_TANGENTS,
    ) -> BetweenBody:
        """The body for its contact with another, see `physics.bodies.between_bodies`."""
        return rigid_between(self.plate_stiffness, size, normal, tangents)

    @ieee_kernel
    def compute(own, load: list[Load], out: Out[Surface], dt):
        laws, stored = floats(own.laws), 0.0
        for i in range(load.count):
            each = nth(load, i)
            push = normal_force(floats(each.forces), vector(each.normal))
            laws[i, 0], laws[i, 1], laws[i, 4] = own.plate_stiffness, 1.0, push / own.plate_stiffness
            stored += 0.5 * push * push / own.plate_stiffness
        spread_laws(own, load)
        send_laws(own, out)
        one(out.stored, stored)
        out.step, out.delayed = dt, oldest(load)
