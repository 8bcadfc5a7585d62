"""The mass-spring body (docs/equations/mass-spring.md)."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Load, Surface, Vector
from palpate.nodes.base import Switch, part
from palpate.nodes.base.contacts import several
from palpate.nodes.base.nodule import WithNodule
from palpate.nodes.base.surface import LEVEL
from palpate.physics.bodies.mass_spring import NodalBody, deeper, mean_hardness, normal_force, shared
from palpate.physics.contact.terminal import Terminal, indentation
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.exact import product

NotNegative = msgspec.Meta(ge=0)


class MassSpring(WithNodule):
    """Nodes on springs and dampers in the zone of influence of the contact.

    The total normal force moves one indentation s by the law K s^n <1 + c s'>; that law is the terminal law as it
    stands, so contact and body together solve the same equations as one solver would. The surface follows by the nodal
    law.

    Several contacts share their forces where their patches overlap: F_i + sum_j O_ij F_j moves s_i, O from 1 at one
    place to 0 at twice the patches' radius. The surface is the deeper of their dents.
    """

    effect = "deformation"
    rank = 1

    stiffness: Annotated[float, "N/m^n", msgspec.Meta(gt=0)] = 3.0e3
    exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=3)] = 1.5
    damping: Annotated[float, "s/m", NotNegative, Switch("relaxation")] = 5.0
    tangential_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 300.0
    tangential_damping: Annotated[float, "N s/m", NotNegative] = 3.0
    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 8e-3  # Of the patch under a finger, where several press

    _count = 1  # of contacts; kept over a start, so that what they need is there before the first step

    def start(self) -> None:
        law = Terminal(self.stiffness, self.exponent, self.damping)
        self._normal_force = entry_point(normal_force, NO_VECTORS, LEVEL)
        self._indentation = entry_point(indentation, 0.0, 0.0, *law)
        self._hardness = self.hardness() if self.nodule_radius > 0.0 else None
        self._contacts(self._count)

    def _contacts(self, count: int) -> None:
        self._count = count
        self._laws = [Terminal(self.stiffness, self.exponent, self.damping)] * count
        self._bodies = [self._nodes() for _ in range(count)]

    def rests(self, load: list[Load]) -> bool:
        idle = not any([len(each.nodes) for each in load] + [law.previous_indentation for law in self._laws])
        return idle and not any(body is not None and body.count for body in self._bodies)

    def step(self, load: list[Load], *, dt: float) -> Surface:
        if len(load) != len(self._laws):
            self._contacts(len(load))
        forces = [self._normal_force(each.forces, each.normal) for each in load]
        acting, coupled = forces, {}
        if len(load) > 1:
            overlap = shared([each.foot for each in load], [each.normal for each in load], self.radius)
            acting = product(overlap, forces).tolist()
        for i, (each, law) in enumerate(zip(load, self._laws, strict=True)):
            stiffness = law.stiffness
            if self._hardness is not None and len(each.nodes):
                stiffness = self.stiffness * mean_hardness(each.nodes, each.forces, each.normal, self._hardness)
            s = self._indentation(acting[i], dt, stiffness, self.exponent, self.damping, 0.0, law.previous_indentation)
            self._laws[i] = Terminal(stiffness, self.exponent, self.damping, 0.0, s)
        if len(load) > 1:
            coupled = several(self._laws, overlap)
        shares = [f / a if a > 0.0 else 1.0 for f, a in zip(forces, acting, strict=True)]
        nodes, displacement = self._moved(load, shares, dt)
        first = self._laws[0]
        return Surface(
            nodes=nodes,
            displacement=displacement,
            stiffness=first.stiffness,
            exponent=self.exponent,
            damping=self.damping,
            rest_indentation=0.0,
            previous_indentation=first.previous_indentation,
            step=dt,
            stored=self._stored(shares),
            **coupled,
        )

    @part("energy", "stored", otherwise=())
    def _stored(self, shares: list[float]) -> Vector:
        """The energy of the law that the normal force moves, K s^(n+1)/(n+1), of each contact its share."""
        grown = self.exponent + 1.0
        stored = [law.stiffness * max(law.previous_indentation, 0.0) ** grown / grown for law in self._laws]
        return (sum([share * energy for share, energy in zip(shares, stored, strict=True)]),)

    @part("shape", "nodes", "displacement", otherwise=None)
    def _nodes(self) -> NodalBody | None:
        """What moves the surface."""
        mesh = self.mesh()
        law = (self.stiffness, self.exponent, self.damping, self.tangential_stiffness, self.tangential_damping)
        return NodalBody(mesh, *law, self._hardness)

    @part("shape", "nodes", "displacement", otherwise=(NO_NODES, NO_VECTORS))
    def _moved(self, load: list[Load], shares: list[float], dt: float) -> tuple[np.ndarray, np.ndarray]:
        """The vertices of the surface that are displaced, and how far [m]; each contact as deep as all forces press
        it."""
        dents = []
        for body, each, share in zip(self._bodies, load, shares, strict=True):
            assert body is not None
            forces = each.forces
            if 0.0 < share < 1.0:
                normal = np.array(each.normal)
                forces = forces + np.outer((1.0 / share - 1.0) * product(forces, normal), normal)
            dents.append(body.step(each.nodes, forces, each.normal, dt))
        return dents[0] if len(dents) == 1 else deeper(dents)
