"""A finite-element organ condensed to its surface, one implicit viscoelastic step at a time.

Full model: K u = f, linear, u displacements, f surface loads. Condensed to the vertices of a coarse surface mesh (loads
spread over the triangles round a vertex, displacements averaged the same way) it is

    u = C h/E,        tau dh/dt + h = f

C [m/N] (3V,3V) is the compliance for a modulus of 1 Pa, E the organ's modulus, tau the retardation time of a
Kelvin-Voigt solid whose damping is proportional to its stiffness. Backward Euler: h <- (tau h + T f)/(T + tau). C is
symmetric and positive, so a step is passive whatever its length: the work done on the body is at least the growth of
the energy h.C h/(2E) that it stores. Only the vertices that carry load now or did a few tau ago hold any h, so that a
step costs what the contact covers, not what the mesh holds.

The patch itself has the compliance of the true load in place of that of the coarse vertices' wider one
(`physics.bodies.true_patch`): V* = h.C h/2E + (c - g.C g/E) y²/2, y the normal force on the patch that h stands for.

With `large_displacement` the organ is nonlinear under the patch: u = dV*/dh instead of C h/E. Its V* is convex,
so the same step stays passive at a place: the load's work is at least the growth of h.u - V*.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np

from palpate.physics.bodies.condensed_basis import Basis
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
from palpate.physics.geometry.mesh import Mesh

LEAST = 1e-9  # [m/N] compliance below which the body counts as rigid


def straight(compliance: float, free: float, now: float) -> Law:
    """The terminal law of a compliance [m/N], a free indentation and the indentation now [m]."""
    return 1.0 / max(compliance, LEAST), 1.0, free, now


class CondensedBody(CoarseBody):
    """The state of a condensed organ under the contact.

    basis     compliance of the coarse surface
    mesh      the surface that loads and displacements are given on, in the same frame as `basis`
    young     [Pa] > 0, modulus E
    retardation  [s] >= 0, tau
    radius    [m] of the patch that the terminal law is taken over while nothing is loaded
    reach     [m] from the foot point within which all displacements are told, fewer farther off
    poisson   [1] of the organ under the patch; None: the compliance of the widened load is left as it is, as the full
              model of the same coarse surface has it
    sticks    whether the surface under the patch sticks to the finger
    apart     [m] (V,) distance of each vertex of `basis` from a nodule or capsule; None where there is neither
    rho       [1] (3,) of large displacement, see `large_displacement`; empty: the organ is linear
    """

    _take: Callable[..., tuple[int, int]]

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
        self._field, self._feet = np.zeros((count, 3), dtype=np.float32), np.zeros((1, 3))
        self._rest(np.zeros((FIELDS, count, 3)), np.zeros((3, count), dtype=np.int64), np.zeros(NUMBERS))
        self._kernels()

    def _rest(self, fields: np.ndarray, marks: np.ndarray, numbers: np.ndarray) -> None:
        """The state of a contact without load, in these arrays of zeros."""
        self._fields, self._marks, self._numbers = fields, marks, numbers
        self.held = self._fields[0]
        """[N] (V,3) loads that the displacement follows, h."""
        self._count = self._touched = 0
        self._normal: tuple = (0.0, 0.0, 0.0)
        self._slope, self._turning = np.zeros(3), np.zeros((3, 3))

    def another(self, fields: np.ndarray, marks: np.ndarray, numbers: np.ndarray) -> CondensedBody:
        """The same organ under another contact, its state in these arrays (FIELDS,V,3), (3,V) and (NUMBERS,) of zeros;
        see `bodies.condensed_contacts`."""
        other = copy.copy(self)
        other._rest(fields, marks, numbers)
        zero = (0.0, 0.0, 0.0)
        other._take = entry_point(
            take_load, self._model, NO_NODES, NO_VECTORS, 0.0, zero, 0.0, fields, marks, numbers, 0
        )
        return other

    def _kernels(self) -> None:
        """What is computed, for arrays as messages hold them."""
        zero, model, fields, numbers = (0.0, 0.0, 0.0), self._model, self._fields, self._numbers
        self._step = entry_point(
            single_step, model, NO_NODES, NO_VECTORS, 0.0, zero, 0.0, fields, self._marks, numbers, 0
        )
        self._along = entry_point(
            along, self._ground, self._marks[2], 0, fields[2], fields[TILT], zero, 0.0, 0.0, 0.0, self._slope,
            self._turning,
        )  # fmt: skip
        self._displaced = entry_point(
            surface_displacements, model, self._feet, self._reach, self._told, fields, self._marks, 0, 0, zero, numbers,
            self._field, self._nodes, self._moved,
        )  # fmt: skip

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
        patch, pull, share = self._patch(nodes, forces, foot, normal)
        self._normal = normal
        self._count, self._touched = self._step(
            self._model, patch, pull, share, normal, dt, self._fields, self._marks, self._numbers, self._count
        )
        compliance, free, now = self._numbers[:MORE].tolist()
        return compliance, free, now

    def step_all(self, loads: Sequence[Pressed], dt: float) -> list[Law]:
        """The law of its one contact, see `step`."""
        return [straight(*self.step(*loads[0], dt))]

    def take(self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float) -> None:
        """The first part of a step, only of what `another` returned: what the linear body does under this load."""
        patch, pull, share = self._patch(nodes, forces, foot, normal)
        self._normal = normal
        self._count, self._touched = self._take(
            self._model, patch, pull, share, normal, dt, self._fields, self._marks, self._numbers, self._count
        )

    @property
    def extrapolation(self) -> float:
        """How far the last step is outside of what the body can tell, 0 within, 1 at twice the limit; `causes` says
        why."""
        return max(self._numbers[DEEP : SLIDES + 1].tolist())

    def causes(self) -> list[str]:
        """Which limits the last step was outside of, see `CAUSES`."""
        excess = self._numbers[DEEP : SLIDES + 1].tolist()
        return [cause for cause, over in zip(CAUSES, excess, strict=True) if over > 0.0]

    def caution(self, cause: str) -> str:
        """What a cause of the last step means, and the error to expect."""
        numbers = self._numbers
        return caution(cause, float(numbers[DEEP + CAUSES.index(cause)]), float(numbers[RADIUS]), float(numbers[WIDE]))

    @property
    def still(self) -> bool:
        """Whether no vertex holds a load any more."""
        return self._count == 0

    def stored(self) -> float:
        """Energy [J] held under the last step's patch at its indentation, V(s) of `place_energy`; what
        tangential loads and places left behind hold is not in it."""
        now, own = float(self._numbers[NOW]), float(self._numbers[OWN])
        if not (now > 0.0 and own > 0.0):
            return 0.0
        radius = float(self._numbers[RADIUS])
        return float(radius * radius / own * stored_energy(now / radius, self._model.rho))

    def along(self, contact: int = 0) -> tuple[tuple[float, float, float], tuple[float, ...]]:
        """What the energy at the force of the last step gains along the surface [N] (3), and how the normal turns there
        [1/m] (9), row by row: see `physics.bodies.place_energy`."""
        radius, compliance, force = self._numbers[[RADIUS, OWN, TOTAL]].tolist()
        self._along(
            self._ground, self._marks[2], self._touched, self._fields[2], self._fields[TILT], self._normal, radius,
            compliance, force, self._slope, self._turning,
        )  # fmt: skip
        x, y, z = self._slope.tolist()
        return (x, y, z), tuple(self._turning.ravel().tolist())

    def displaced(self, *feet: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the mesh, all near the foot point and fewer farther off, and their displacements [m] (k,3)."""
        self._feet[:] = feet
        count = self._displaced(
            self._model, self._feet, self._reach, self._told, self._fields, self._marks, self._count, self._touched,
            self._normal, self._numbers, self._field, self._nodes, self._moved,
        )  # fmt: skip
        return self._nodes[:count], self._moved[:count]
