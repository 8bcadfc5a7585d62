"""A finite-element organ condensed to its surface, one implicit viscoelastic step at a time.

Full model: K u = f, linear. Condensed to the vertices of a coarse surface mesh (loads spread over the triangles round a
vertex, displacements averaged the same way) it is

    u = C h/E,        tau dh/dt + h = f

C [m/N] (3V,3V) is the compliance for a modulus of 1 Pa, E the organ's modulus, tau the retardation time of a
Kelvin-Voigt solid whose damping is proportional to its stiffness. Backward Euler: h <- (tau h + T f)/(T + tau). C is
symmetric and positive, so a step is passive whatever its length: the work done on the body is at least the growth of
the energy h.C h/(2E). Only vertices that carry load now or did a few tau ago hold any h.

The patch itself has the compliance of the true load (`physics.bodies.true_patch`): V* = h.C h/2E + (c - g.C g/E) y²/2,
y the normal force on the patch that h stands for. With `large_displacement` u = dV*/dh instead of C h/E; its V* is
convex, so the same step stays passive at a place: the load's work is at least the growth of h.u - V*.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_contacts import joint_answer, joint_profile
from palpate.physics.bodies.condensed_field import surface_displacements
from palpate.physics.bodies.condensed_step import (
    DEEP,
    FIELDS,
    MORE,
    NOW,
    NUMBERS,
    OWN,
    RADIUS,
    SLIDES,
    TILT,
    TOTAL,
    WIDE,
    CondensedModel,
    single_step,
    take_load,
)
from palpate.physics.bodies.half_space_range import CAUSES, caution
from palpate.physics.bodies.large_displacement import stored_energy
from palpate.physics.bodies.patch import CoarseBody, Law, Pressed, hat_moments
from palpate.physics.bodies.place_energy import Ground, along, softness, weight_slopes
from palpate.physics.bodies.true_patch import true_patch, uncorrected
from palpate.physics.entry_point import NO_FLOATS, NO_NODES, NO_VECTORS, entry_point
from palpate.physics.exact import product
from palpate.physics.geometry.mesh import Mesh

LEAST = 1e-9  # [m/N] compliance below which the body counts as rigid


def straight(compliance: float, free: float, now: float) -> Law:
    """The terminal law of a compliance [m/N], a free indentation and the indentation now [m]."""
    return 1.0 / max(compliance, LEAST), 1.0, free, now


class CondensedBody(CoarseBody):
    """The state of a condensed organ under one contact, or several (`under`).

    mesh      the surface that loads and displacements are given on, in the same frame as `basis`
    young [Pa] > 0, retardation [s] >= 0   E, tau
    radius    [m] of the patch that the terminal law is taken over while nothing is loaded
    reach     [m] from the foot point within which all displacements are told, fewer farther off
    poisson   [1] of the organ under the patch; None: the compliance of the widened load is left as it is
    sticks    whether the surface under the patch sticks to the finger
    apart     [m] (V,) distance of each vertex of `basis` from a nodule or capsule; None where there is neither
    rho       [1] (3,) of large displacement, see `large_displacement`; empty: the organ is linear
    """

    def __init__(
        self,
        basis: Basis,
        mesh: Mesh,
        young: float,
        retardation: float,
        radius: float,
        reach: float,
        poisson: float | None = None,
        sticks: bool = True,
        apart: np.ndarray | None = None,
        rho: np.ndarray = NO_FLOATS,
    ) -> None:
        coarse = Mesh(basis.vertices, basis.triangles)
        super().__init__(coarse, mesh, radius, reach)
        self.basis, self.young, self.retardation = basis, young, retardation
        count, rho = len(basis.vertices), np.array(rho)
        moments = hat_moments(coarse)
        true = uncorrected(mesh) if poisson is None else true_patch(coarse, mesh, poisson, sticks, apart)
        slopes = weight_slopes(coarse, self.corners)
        self._model = CondensedModel(
            basis.compliance, basis.vertices, rho, moments, self.corners, self.weights, slopes, young, retardation,
            mesh.vertices, true,
        )  # fmt: skip
        self._ground = Ground(coarse.normals, softness(coarse, self._model, self._spreader), rho)
        self._field = np.zeros((count, 3), dtype=np.float32)
        self._gradient, self._shape = np.zeros(3), np.zeros((3, 3))
        self._rest(1)

    def under(self, count: int) -> CondensedBody:
        """The same organ under so many contacts, at rest."""
        other = copy.copy(self)
        other._rest(count)
        return other

    def _rest(self, count: int) -> None:
        """The state of so many contacts without load, and the kernels for arrays as messages hold them."""
        model, zero, size = self._model, (0.0, 0.0, 0.0), len(self.basis.vertices)
        self._fields = np.zeros((count, FIELDS, size, 3))
        self._marks, self._numbers = np.zeros((count, 3, size), dtype=np.int64), np.zeros((count, NUMBERS))
        self._counts = np.zeros((count, 3), dtype=np.int64)
        self._normals, self._feet = np.zeros((2, count, 3))
        self._coupling, self._cross = np.eye(count), np.zeros((count, count))
        self._drawn, self._bears = np.zeros((count, 3)), np.zeros(count)
        self._contacts = list(zip(self._fields, self._marks, self._numbers, strict=True))
        self._state = (self._fields, self._marks, self._numbers, self._counts, self._normals, self._feet)
        fields, marks, numbers = self._contacts[0]
        kernel = single_step if count == 1 else take_load
        self._take = entry_point(kernel, model, NO_NODES, NO_VECTORS, 0.0, zero, 0.0, fields, marks, numbers, 0)
        self._along = entry_point(
            along, self._ground, marks[2], 0, fields[2], fields[TILT], zero, 0.0, 0.0, 0.0, self._gradient, self._shape
        )
        shown = (*self._state, self._field, self._nodes, self._moved)
        self._displaced = entry_point(surface_displacements, model, self._reach, self._told, *shown)
        if count > 1:
            profile, room = joint_profile(), np.zeros((count, 4, size))
            self._joint = (profile, *self._state, room, self._cross, self._coupling, self._drawn)
            self._answer = entry_point(joint_answer, model, *self._joint, 0.0)

    @property
    def held(self) -> np.ndarray:
        """[N] (V,3) loads that the displacement under the first contact follows, h."""
        return self._fields[0, 0]

    @property
    def coupling(self) -> np.ndarray:
        return self._coupling

    def step(
        self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float
    ) -> tuple[float, float, float]:
        """One step of dt > 0 [s] under nodal forces [N] (k,3): (c, s_free, s), the next step's compliance [m/N] and
        free indentation [m] under the patch, and the indentation now [m].

        The indentation is the mean of -n.u over the patch, weighted as the force is, so that force times indentation
        is the work done on the body. With large displacement c is that of the chord to the next step's indentation at
        the present force (at least `LEAST_FORCE`), or that of the tangent there if it is greater, with the s_free that
        goes with it: so force and indentation there are the body's own, and contact that is solved against it settles.
        """
        return self.steps([(nodes, forces, foot, normal)], dt)[0]

    def steps(self, loads: Sequence[Pressed], dt: float) -> list[tuple[float, float, float]]:
        """One step of dt > 0 [s] under all loads: (c, s_free, s) of each, the next step's compliance [m/N] and free
        indentation [m] under the patch, and the indentation now [m].

        The indentation is the mean of -n.u over the patch, weighted as the force is, so that force times indentation
        is the work done on the body. With large displacement c is that of the chord to the next step's indentation at
        the present force (at least `LEAST_FORCE`), or that of the tangent there if it is greater, with the s_free that
        goes with it: so force and indentation there are the body's own, and contact that is solved against it settles.
        """
        for i, (nodes, forces, foot, normal) in enumerate(loads):
            patch, pull, share = self._patch(nodes, forces, foot, normal)
            self._feet[i], self._normals[i] = foot, normal
            count = int(self._counts[i, 0])
            self._counts[i, :2] = self._take(self._model, patch, pull, share, normal, dt, *self._contacts[i], count)
        if len(loads) > 1:
            self._answer(self._model, *self._joint, dt)
            take = dt / (dt + self.retardation)
            self._bears = (1.0 - take) * self._bears + take * self._numbers[:, TOTAL]
        laws: list[tuple[float, float, float]] = self._numbers[:, :MORE].tolist()
        return laws

    def step_all(self, loads: Sequence[Pressed], dt: float) -> list[Law]:
        return [straight(*law) for law in self.steps(loads, dt)]

    @property
    def extrapolation(self) -> float:
        return max(self._numbers[:, DEEP : SLIDES + 1].ravel().tolist())

    def causes(self) -> list[str]:
        excess = self._numbers[:, DEEP : SLIDES + 1].max(axis=0).tolist()
        return [cause for cause, over in zip(CAUSES, excess, strict=True) if over > 0.0]

    def caution(self, cause: str) -> str:
        excess = DEEP + CAUSES.index(cause)
        numbers = self._numbers[self._numbers[:, excess].argmax()]
        return caution(cause, float(numbers[excess]), float(numbers[RADIUS]), float(numbers[WIDE]))

    @property
    def still(self) -> bool:
        return not self._counts[:, 0].any()

    def stored(self) -> float:
        """Energy [J] held under the last step's patches at their indentations, V(s) of `place_energy`: of each the
        share that its own force has in what presses there. For a linear body that is f.C f/2; what tangential loads
        and places left behind hold is not in it."""
        if len(self._numbers) == 1:
            return self._under(self._numbers[0])
        own = np.maximum(self._numbers[:, OWN], 1e-300)
        acting = self._bears + product(self._cross, self._bears) / own
        share = np.divide(self._bears, acting, out=np.zeros_like(acting), where=acting > 0.0)
        return float(sum(part * self._under(one) for part, one in zip(share.tolist(), self._numbers, strict=True)))

    def _under(self, numbers: np.ndarray) -> float:
        now, own, radius = numbers[[NOW, OWN, RADIUS]].tolist()
        if not (now > 0.0 and own > 0.0):
            return 0.0
        return float(radius * radius / own * stored_energy(now / radius, self._model.rho))

    def along(self, contact: int = 0) -> tuple[tuple[float, float, float], tuple[float, ...]]:
        """What the energy at the force of the last step gains along the surface [N] (3), and how the normal turns there
        [1/m] (9), row by row: see `physics.bodies.place_energy`."""
        fields, marks, numbers = self._contacts[contact]
        radius, compliance, force = numbers[[RADIUS, OWN, TOTAL]].tolist()
        touched, normal = int(self._counts[contact, 1]), tuple(self._normals[contact].tolist())
        self._along(
            self._ground, marks[2], touched, fields[2], fields[TILT], normal, radius, compliance, force,
            self._gradient, self._shape,
        )  # fmt: skip
        gradient = self._gradient if len(self._contacts) == 1 else self._gradient + self._drawn[contact]
        x, y, z = gradient.tolist()
        return (x, y, z), tuple(self._shape.ravel().tolist())

    def displaced(self, *feet: tuple) -> tuple[np.ndarray, np.ndarray]:
        self._feet[:] = feet
        count = self._displaced(
            self._model, self._reach, self._told, *self._state, self._field, self._nodes, self._moved
        )
        return self._nodes[:count], self._moved[:count]
