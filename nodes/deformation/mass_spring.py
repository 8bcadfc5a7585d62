"""The mass-spring body (docs/equations/mass-spring.md)."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Load, Surface, Vector
from palpate.nodes.base import Switch, part
from palpate.nodes.base.nodule import WithNodule
from palpate.nodes.base.surface import LEVEL
from palpate.physics.bodies.mass_spring import NodalBody, mean_hardness, normal_force
from palpate.physics.bodies.spring_net import NetBody
from palpate.physics.contact.terminal import indentation
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point

NotNegative = msgspec.Meta(ge=0)


class MassSpring(WithNodule):
    """Nodes on springs and dampers in the zone of influence of the contact.

    The total normal force moves one indentation s by the law K s^n <1 + c s'>; that law is the terminal law as it
    stands, so contact and body together solve the same equations as one solver would. The surface follows by the nodal
    law, or with `coupling` by a net of springs between neighbours, which costs far more and leaves the force as it is.
    """

    effect = "deformation"
    rank = 1

    stiffness: Annotated[float, "N/m^n", msgspec.Meta(gt=0)] = 3.0e3
    exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=3)] = 1.5
    damping: Annotated[float, "s/m", NotNegative, Switch("relaxation")] = 5.0
    tangential_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 300.0
    tangential_damping: Annotated[float, "N s/m", NotNegative] = 3.0
    coupling: Annotated[float, "N/m", NotNegative, Switch("coupling")] = 0.0
    """of a spring between neighbours; 0: none, every node moves by itself"""
    coupling_damping: Annotated[float, "N s/m", NotNegative] = 0.1
    rings: Annotated[int, "1", msgspec.Meta(ge=0, le=50)] = 3
    """of neighbours round the loaded nodes that move with them in the net"""

    def start(self) -> None:
        self.indentation = 0.0
        self._law = (self.stiffness, self.exponent, self.damping, 0.0)
        self._normal_force = entry_point(normal_force, NO_VECTORS, LEVEL)
        self._indentation = entry_point(indentation, 0.0, 0.0, *self._law, 0.0)
        self._hardness = self.hardness() if self.nodule_radius > 0.0 else None
        self._body = self._nodes()

    def rests(self, load: Load) -> bool:
        return not len(load.nodes) and self.indentation == 0.0 and (self._body is None or not self._body.net.count)

    def step(self, load: Load, *, dt: float) -> Surface:
        force = self._normal_force(load.forces, load.normal)
        if self._hardness is not None and len(load.nodes):
            harder = self.stiffness * mean_hardness(load.nodes, load.forces, load.normal, self._hardness)
            self._law = (harder, self.exponent, self.damping, 0.0)
        self.indentation = self._indentation(force, dt, *self._law, self.indentation)
        nodes, displacement = self._moved(load, dt)
        return Surface(
            nodes=nodes,
            displacement=displacement,
            stiffness=self._law[0],
            exponent=self.exponent,
            damping=self.damping,
            rest_indentation=0.0,
            previous_indentation=self.indentation,
            step=dt,
            stored=self._stored(),
        )

    @part("energy", "stored", otherwise=())
    def _stored(self) -> Vector:
        """The energy of the law that the normal force moves, K s^(n+1)/(n+1)."""
        grown = self.exponent + 1.0
        return (self._law[0] * max(self.indentation, 0.0) ** grown / grown,)

    @part("shape", "nodes", "displacement", otherwise=None)
    def _nodes(self) -> NodalBody | NetBody | None:
        """What moves the surface."""
        mesh = self.mesh()
        law = (self.stiffness, self.exponent, self.damping, self.tangential_stiffness, self.tangential_damping)
        if self.coupling > 0.0:
            return NetBody(mesh, *law, self.coupling, self.coupling_damping, self.rings, self._hardness)
        return NodalBody(mesh, *law, self._hardness)

    @part("shape", "nodes", "displacement", otherwise=(NO_NODES, NO_VECTORS))
    def _moved(self, load: Load, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """The vertices of the surface that are displaced, and how far [m]."""
        assert self._body is not None
        return self._body.step(load.nodes, load.forces, load.normal, dt)
