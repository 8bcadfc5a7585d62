"""Loads and bodies for tests of physics: kernels with their working memory."""

import numpy as np

from palpate.physics.bodies import condensed_body, mass_spring, sampled_body
from palpate.physics.bodies.half_space_range import CAUSES, caution
from palpate.physics.contact import spread as spreading


def _three(vector):
    return tuple(map(float, vector))


def _load(nodes, forces, foot, normal):
    return np.array(nodes, np.int32), np.array(forces, float), _three(foot), _three(normal)


class Spreader:
    """Spreads a force over a mesh."""

    def __init__(self, mesh, radius, kernel="biweight"):
        self._own = spreading.spreader(mesh, radius, kernel)
        self.nodes, self.weights, self.forces = self._own.nodes, self._own.weights, self._own.forces

    def spread(self, foot, normal, force, radius=0.0):
        return spreading.spread(self._own, _three(foot), _three(normal), _three(force), radius)


class NodalBody:
    """The nodal law of the mass-spring body on a mesh, under one contact."""

    def __init__(self, mesh, *law):
        self.own = mass_spring.nodal_body(mesh, *law)

    def step(self, nodes, forces, normal, dt):
        count = mass_spring.move(self.own, 0, nodes, forces, normal, dt)
        return self.own.active[0, :count], self.own.moved[0, :count]


class CondensedBody:
    """A condensed organ under one contact, or several (`under`). A step returns for each contact the compliance and the
    free indentation of the next step, and the present indentation."""

    def __init__(self, basis, mesh, *law, **more):
        self.own, self.mesh = condensed_body.condensed_body(basis, mesh, *law, **more), mesh

    @classmethod
    def of(cls, node):
        """The body of a ReducedFE node."""
        it = cls.__new__(cls)
        it.own, it.mesh = node._make_shared(), node.mesh()
        return it

    def under(self, count):
        it = type(self).__new__(type(self))
        it.own, it.mesh = condensed_body.under(*self.own[:3], count), self.mesh
        return it

    def step(self, nodes, forces, foot, normal, dt):
        return self.steps([(nodes, forces, foot, normal)], dt)[0]

    def steps(self, loads, dt):
        for contact, load in enumerate(loads):
            condensed_body.bear(self.own, contact, *_load(*load), dt)
        self.laws = np.zeros((len(loads), 5))
        condensed_body.answer(self.own, self.laws, dt)
        return [[each.compliance, each.free, each.now] for each in self.own.contacts]

    def displaced(self, *feet):
        self.own.feet[:] = feet
        count = condensed_body.displace_fine(self.own)
        return self.own.fine.nodes[:count], self.own.fine.moved[:count]

    def along(self, contact=0):
        condensed_body.slope(self.own, contact)
        return tuple(self.own.gradient.tolist()), tuple(self.own.shape.ravel().tolist())

    def stored(self):
        return condensed_body.patch_energy(self.own)

    @property
    def held(self):
        """Loads that determine the displacement under the first contact."""
        return self.own.fields[0, 0]

    @property
    def still(self):
        return condensed_body.is_still(self.own)

    @property
    def extrapolation(self):
        return condensed_body.extrapolation(self.own)

    def causes(self):
        excess = np.max([each.excess.item() for each in self.own.contacts], axis=0)
        return [cause for cause, over in zip(CAUSES, excess, strict=True) if over > 0.0]

    def caution(self, cause):
        one = self.own.contacts[0]
        return caution(cause, one.excess.item()[CAUSES.index(cause)], float(one.radius), float(one.wide))


class SampledBody:
    """A sampled body under one contact, or several (`step_all`). A step returns K, n and the free indentation of the
    next step, and the present indentation."""

    def __init__(self, basis, mesh, *law):
        self.basis, self._given = basis, (basis, mesh, *law)
        self._under(1)

    @classmethod
    def of(cls, node):
        """The body of a ReducedFE node."""
        basis, given = node._place_basis()
        return cls(basis, *given)

    def _under(self, count):
        self.own = sampled_body.sampled_body(*self._given, count)
        self.q, self.held, self.contacts = self.own.vectors[1], self.own.fields[0], self.own.contacts

    def step(self, nodes, forces, foot, normal, dt):
        return self.step_all([(nodes, forces, foot, normal)], dt)[0]

    def step_all(self, loads, dt):
        if len(loads) != len(self.own.feet):
            self._under(len(loads))
        for contact, load in enumerate(loads):
            sampled_body.bear(self.own, contact, *_load(*load))
        laws = np.zeros((len(loads), 5))
        self.coupling = np.eye(len(loads))
        self.evaluations, self.settled = sampled_body.answer(self.own, laws, self.coupling, dt)
        return laws[:, [0, 1, 3, 4]].tolist()

    def displaced(self, *feet):
        self.own.feet[:] = feet
        count = sampled_body.displace_fine(self.own)
        return self.own.fine.nodes[:count], self.own.fine.moved[:count]
