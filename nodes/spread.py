"""Spreading of the contact force over the surface (docs/equations/spread.md)."""

import math
from typing import Annotated, Literal

import msgspec

from palpate.messages import Contact, Friction, Load, Vector3
from palpate.nodes.base import Wants
from palpate.nodes.base.absence import FADE, Faded
from palpate.nodes.base.surface import OnSurface
from palpate.physics.contact.spread import Spreader
from palpate.physics.entry_point import NO_NODES, NO_VECTORS

RIGID = 5e4
"""[N/m] Force over compression from which on a finger counts as rigid; a fingertip that bears 10 N has some 3e3."""


class Kernel(OnSurface):
    """Spreads the contact force over the nodes round the foot point with a smooth kernel.

    The force on the body is -f_n n + f_t; the nodal forces sum to it. Without force the load has no nodes. A friction
    whose sender is gone fades out within 20 ms. The patch keeps its width whatever the depth; that of a rigid tip does
    not, which is reported.
    """

    kernel: Annotated[Literal["biweight", "wendland", "cosine"], "1"] = "biweight"
    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 8e-3

    def start(self) -> None:
        self._spreader = Spreader(self.mesh(), self.radius, self.kernel)
        self._friction = Faded(FADE)
        self._idle_at: tuple[Vector3, Vector3] | None = None
        self._rigid = self._cautioned = False
        self._notes = []

    _rigid = False

    def condition(self) -> str:
        return "outside its range" if self._rigid else ""

    def rests(self, contact: Contact, friction: Friction | None) -> bool:
        return not contact.force > 0.0 and self._idle_at == (contact.foot, contact.normal)

    def step(
        self,
        contact: Annotated[Contact, Wants("foot", "normal", "force", "compression", "indentation")],
        friction: Annotated[Friction | None, Wants("force")],
        *,
        dt: float = math.inf,
    ) -> Load:
        nodes, forces, self._rigid = NO_NODES, NO_VECTORS, False
        t = self._friction.update(None if friction is None else friction.force, dt)
        self._idle_at = (contact.foot, contact.normal)
        if contact.force > 0.0:
            self._idle_at = None
            self._rigid = contact.force > RIGID * contact.compression
            if self._rigid and not self._cautioned:
                self._caution(contact)
            f, n = contact.force, contact.normal
            force = (t[0] - f * n[0], t[1] - f * n[1], t[2] - f * n[2])
            count = self._spreader.spread(contact.foot, n, force)
            nodes, forces = self._spreader.nodes[:count], self._spreader.forces[:count]
        return Load(nodes=nodes, forces=forces, foot=contact.foot, normal=contact.normal)

    def _caution(self, contact: Contact) -> None:
        self._cautioned = True
        give, deep, width = 1e3 * contact.compression, 1e3 * contact.indentation, 1e3 * self.radius
        self._notes.append(
            f"Kernel: the finger gives {give:.2g} mm where the body gives {deep:.2g} mm, as a rigid tip does. The "
            f"contact of a rigid ball of radius r widens with the depth s, to sqrt(r s); this patch keeps {width:.2g} "
            f"mm. A body that answers to its load (ReducedFE) takes {width:.2g} mm/sqrt(r s) times the force: "
            f"{0.5 * width:.2g} times for r = 8 mm at s = 0.5 mm. MassSpring with Hertz's constant takes the right one"
        )
