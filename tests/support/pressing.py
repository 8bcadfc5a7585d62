"""Loads and bodies for tests of physics: kernels with the memory that they work in."""

from palpate.physics.bodies import mass_spring
from palpate.physics.contact import spread as spreading


class Spreader:
    """Spreads a force over a mesh."""

    def __init__(self, mesh, radius, kernel="biweight"):
        self._own = spreading.spreader(mesh, radius, kernel)
        self.nodes, self.weights, self.forces = self._own.nodes, self._own.weights, self._own.forces

    def spread(self, foot, normal, force):
        return spreading.spread(self._own, *(tuple(map(float, one)) for one in (foot, normal, force)))


class NodalBody:
    """The nodal law of the mass-spring body on a mesh, under one contact."""

    def __init__(self, mesh, *law):
        self.own = mass_spring.nodal_body(mesh, *law)

    def step(self, nodes, forces, normal, dt):
        count = mass_spring.move(self.own, 0, nodes, forces, normal, dt)
        return self.own.active[0, :count], self.own.moved[0, :count]
