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

from typing import Annotated, NamedTuple

import numpy as np

from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_contacts import joint_answer, joint_profile
from palpate.physics.bodies.condensed_field import surface_displacements
from palpate.physics.bodies.condensed_step import (
    COMPLIANCE,
    DEEP,
    FIELDS,
    FREE,
    NOW,
    NUMBERS,
    OWN,
    RADIUS,
    SLIDES,
    TILT,
    TOTAL,
    CondensedModel,
    add_others,
    take_load,
)
from palpate.physics.bodies.large_displacement import stored_energy
from palpate.physics.bodies.patch import FineMesh, fine_mesh, hat_moments, lies_on, patch_of
from palpate.physics.bodies.place_energy import Ground, along, softness, weight_slopes
from palpate.physics.bodies.true_patch import true_patch, uncorrected
from palpate.physics.entry_point import NO_FLOATS
from palpate.physics.exact import row_times
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel

LEAST = 1e-9  # [m/N] compliance below which the body counts as rigid


class CondensedBody(NamedTuple):
    """A condensed organ and its state under c contacts: for each its fields, marks and numbers
    (`condensed_step.take_load`)."""

    model: CondensedModel
    ground: Ground
    fine: FineMesh
    fields: Annotated[np.ndarray, "<f8", 4]  # (c,F,V,3)
    marks: Annotated[np.ndarray, "<i8", 3]  # (c,3,V)
    numbers: Annotated[np.ndarray, "<f8", 2]
    counts: Annotated[np.ndarray, "<i8", 2]  # (c,3) vertices that hold load, that the patch touches, and both
    normals: Annotated[np.ndarray, "<f8", 2]  # [1] (c,3)
    feet: Annotated[np.ndarray, "<f8", 2]  # [m] (c,3)
    coupling: Annotated[np.ndarray, "<f8", 2]  # [1] (c,c) O, see `physics.contact.joint`
    cross: Annotated[np.ndarray, "<f8", 2]  # [m/N] (c,c) compliance between patches; the diagonal is 0
    drawn: Annotated[np.ndarray, "<f8", 2]  # [N] (c,3) how the energy changes along the surface by the others
    bears: Annotated[np.ndarray, "<f8", 1]  # [N] (c) normal force with the body's retardation
    profile: Annotated[np.ndarray, "<f8", 1]  # see `condensed_contacts.joint_profile`; of several contacts
    room: Annotated[np.ndarray, "<f8", 3]
    field: Annotated[np.ndarray, "<f4", 2]  # [m] (V,3) room for the displacement of the coarse vertices
    gradient: Annotated[np.ndarray, "<f8", 1]  # [N] (3) and shape [1/m] (3,3) of the last `slope`
    shape: Annotated[np.ndarray, "<f8", 2]


def condensed_body(
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
) -> CondensedBody:
    """A body at rest under one contact.

    mesh      the surface that loads and displacements are given on, in the same frame as `basis`
    young [Pa] > 0, retardation [s] >= 0   E, tau
    radius    [m] of the patch that the terminal law is taken over while nothing is loaded
    reach     [m] from the foot point within which all displacements are told, fewer farther off
    poisson   [1] of the organ under the patch; None: the compliance of the widened load is left as it is
    sticks    whether the surface under the patch sticks to the finger
    apart     [m] (V,) distance of each vertex of `basis` from a nodule or capsule; None where there is neither
    rho       [1] (3,) of large displacement, see `large_displacement`; empty: the organ is linear
    """
    coarse, fine, rho = Mesh(basis.vertices, basis.triangles), fine_mesh(mesh, radius, reach), np.array(rho)
    corners, weights = lies_on(coarse, mesh)
    model = CondensedModel(
        basis.compliance, basis.vertices, rho, hat_moments(coarse), corners, weights, weight_slopes(coarse, corners),
        young, retardation, mesh.vertices,
        uncorrected(mesh) if poisson is None else true_patch(coarse, mesh, poisson, sticks, apart),
    )  # fmt: skip
    ground = Ground(coarse.normals, softness(coarse, model, fine.spreader), rho)
    return under(model, ground, fine, 1)


def under(model: CondensedModel, ground: Ground, fine: FineMesh, count: int) -> CondensedBody:
    """An organ under so many contacts, at rest."""
    size, several = len(model.vertices), count if count > 1 else 0
    return CondensedBody(
        model, ground, fine, np.zeros((count, FIELDS, size, 3)), np.zeros((count, 3, size), np.int64),
        np.zeros((count, NUMBERS)), np.zeros((count, 3), np.int64), np.zeros((count, 3)), np.zeros((count, 3)),
        np.eye(count), np.zeros((count, count)), np.zeros((count, 3)), np.zeros(count),
        joint_profile() if several else np.zeros(0), np.zeros((several, 4, size)), np.zeros((size, 3), np.float32),
        np.zeros(3), np.zeros((3, 3)),
    )  # fmt: skip


@kernel(error_model="numpy")
def bear(body, contact, nodes, forces, foot, normal, dt):
    """Take the load of a contact, nodal forces [N] (k,3), in a step of dt > 0 [s]; `answer` follows for all."""
    patch, pull, share = patch_of(body.fine, nodes, forces, foot, normal)
    for i in range(3):
        body.feet[contact, i], body.normals[contact, i] = foot[i], normal[i]
    counts = body.counts[contact]
    counts[0], counts[1] = take_load(
        body.model, patch, pull, share, normal, dt, body.fields[contact], body.marks[contact], body.numbers[contact],
        counts[0],
    )  # fmt: skip


@kernel(error_model="numpy")
def answer(body, laws, dt):
    """Fill the first three of `numbers` of each contact: the next step's compliance c [m/N] and free indentation
    s_free [m] under the patch, and the indentation s now [m]; and `laws` (c,5), K, n, c, s_free and s_prev of each.

    The indentation is the mean of -n.u over the patch, weighted as the force is, so that force times indentation is the
    work done on the body. With large displacement c is that of the chord to the next step's indentation at the present
    force (at least `LEAST_FORCE`), or that of the tangent there if it is greater, with the s_free that goes with it: so
    force and indentation there are the body's own, and contact that is solved against it settles.
    """
    model = body.model
    if len(body.counts) == 1:
        add_others(model, dt, body.numbers[0], 0.0, 0.0)
    else:
        joint_answer(
            model, body.profile, body.fields, body.marks, body.numbers, body.counts, body.normals, body.feet,
            body.room, body.cross, body.coupling, body.drawn, dt,
        )  # fmt: skip
        take = dt / (dt + model.retardation)
        for i in range(len(body.bears)):
            body.bears[i] = (1.0 - take) * body.bears[i] + take * body.numbers[i, TOTAL]
    for i in range(len(laws)):
        compliance, free, now = body.numbers[i, COMPLIANCE], body.numbers[i, FREE], body.numbers[i, NOW]
        laws[i, 0], laws[i, 1], laws[i, 3], laws[i, 4] = 1.0 / max(compliance, LEAST), 1.0, free, now


@kernel
def extrapolation(body):
    """How far the last step is outside of what the body can tell, 0 within, 1 at twice the limit."""
    most = 0.0
    for numbers in body.numbers:
        for excess in numbers[DEEP : SLIDES + 1]:
            most = max(most, excess)
    return most


@kernel
def is_still(body):
    """Whether nothing of an earlier load is left."""
    held = 0
    for counts in body.counts:
        held += counts[0]
    return held == 0


@kernel(error_model="numpy")
def stored(body):
    """Energy [J] held under the last step's patches at their indentations, V(s) of `place_energy`: of each the share
    that its own force has in what presses there. For a linear body that is f.C f/2; what tangential loads and places
    left behind hold is not in it."""
    if len(body.bears) == 1:
        return _held_under(body.numbers[0], body.model.rho)
    total = 0.0
    for i in range(len(body.bears)):
        acting = body.bears[i] + row_times(body.cross[i], body.bears) / max(body.numbers[i, OWN], 1e-300)
        share = body.bears[i] / acting if acting > 0.0 else 0.0
        total += share * _held_under(body.numbers[i], body.model.rho)
    return total


@kernel(error_model="numpy")
def _held_under(numbers, rho):
    now, own, radius = numbers[NOW], numbers[OWN], numbers[RADIUS]
    if not (now > 0.0 and own > 0.0):
        return 0.0
    return radius * radius / own * stored_energy(now / radius, rho)


@kernel(error_model="numpy")
def slope(body, contact):
    """Fill `gradient`, what the energy at the force of the last step gains along the surface [N] (3), and `shape`, how
    the normal turns there [1/m] (3,3): see `physics.bodies.place_energy`."""
    fields, numbers, n = body.fields[contact], body.numbers[contact], body.normals[contact]
    along(
        body.ground, body.marks[contact, 2], body.counts[contact, 1], fields[2], fields[TILT], (n[0], n[1], n[2]),
        numbers[RADIUS], numbers[OWN], numbers[TOTAL], body.gradient, body.shape,
    )  # fmt: skip
    if len(body.counts) > 1:
        for i in range(3):
            body.gradient[i] += body.drawn[contact, i]


@kernel(error_model="numpy")
def displaced(body):
    """Fill `fine.nodes`, vertices of the mesh, all near the foot points of the last step and fewer farther off, and
    `fine.moved`, their displacements [m]; how many. None where the body is still."""
    if is_still(body):
        return 0
    return surface_displacements(
        body.model, body.fine.reach, body.fine.told, body.fields, body.marks, body.numbers, body.counts, body.normals,
        body.feet, body.field, body.fine.nodes, body.fine.moved,
    )  # fmt: skip
