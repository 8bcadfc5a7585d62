"""Static condensation of a finite-element organ to its surface, with implicit viscoelastic steps.

The full linear model K u = f, condensed to the vertices of a coarse surface mesh (loads are distributed over the
triangles round a vertex, displacements averaged with the same weights), is

    u = C h/E,        tau dh/dt + h = f

C [m/N] (3V,3V) is the compliance for a modulus of 1 Pa, E the organ's modulus, tau the retardation time of a
Kelvin-Voigt solid with stiffness-proportional damping. Backward Euler: h <- (tau h + T f)/(T + tau). C is symmetric and
positive, so a step of any length is passive: the work on the body is at least the increase of the energy h.C h/(2E). A
step of second order (`physics.contact.end_rate`) first scales h, and is not passive in itself. h is nonzero only at
vertices that are loaded or were loaded a few tau ago.

The patch has the compliance of the true load (`physics.bodies.true_patch`): V* = h.C h/2E + (c - g.C g/E) y²/2, with
the normal force y on the patch that corresponds to h. With `large_displacement` u = dV*/dh; its V* is convex, so the
step remains passive for a constant foot point: the work is at least the increase of h.u - V*.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.entry_point import NO_FLOATS
from palpate.compiler.exact import row_times
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Indices, Matrix, Record, Vector3
from palpate.physics.bodies import condensed_step as step
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_contacts import KEPT_TYPE, joint_answer
from palpate.physics.bodies.condensed_field import add_field, add_half_space
from palpate.physics.bodies.large_displacement import DEEPEST, DEEPEST_COVERED, stored_energy
from palpate.physics.bodies.loads.pairs import joint_profile
from palpate.physics.bodies.patch import FineMesh, fine_mesh, hat_moments, interpolate_fine, lies_on, patch_of, respread
from palpate.physics.bodies.place_energy import Ground, along, softness, weight_slopes
from palpate.physics.bodies.true_patch import true_patch, without_correction
from palpate.physics.contact.area import FIXED, MEAN, AreaLaw, approach, with_approach
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.indices import check_indices

LEAST = 1e-9  # [m/N] Lower limit of the compliance


class CondensedBody(NamedTuple):
    """A condensed organ and its state: fields, marks and state of each of c contacts (`condensed_step.take_load`)."""

    model: step.CondensedModel
    ground: Ground
    fine: FineMesh
    fields: Annotated[np.ndarray, "<f8", 4]  # (c,F,V,3)
    marks: Annotated[np.ndarray, "<i8", 3]  # (c,3,V)
    contacts: Annotated[np.ndarray, step.CONTACT_TYPE, 1]  # (c,)
    counts: Annotated[np.ndarray, "<i8", 2]  # (c,3) number of loaded vertices, of those of the patch, and of both
    normals: Annotated[np.ndarray, "<f8", 2]  # [1] (c,3)
    feet: Annotated[np.ndarray, "<f8", 2]  # [m] (c,3)
    coupling: Annotated[np.ndarray, "<f8", 2]  # [1] (c,c) O, see `physics.contact.joint`
    cross: Annotated[np.ndarray, "<f8", 2]  # [m/N] (c,c) compliance between patches; the diagonal is 0
    drawn: Annotated[np.ndarray, "<f8", 2]  # [N] (c,3) tangential energy gradient due to the other contacts
    kept: Annotated[np.ndarray, KEPT_TYPE, 2]  # (c,c), see `condensed_contacts.joint_answer`
    profile: Annotated[np.ndarray, "<f8", 1]  # for several contacts, see `loads.pairs.joint_profile`
    room: Annotated[np.ndarray, "<f8", 3]  # workspaces
    vectors: Annotated[np.ndarray, "<f8", 3]
    field: Annotated[np.ndarray, "<f4", 2]  # [m] (V,3) workspace, displacement of the coarse vertices
    gradient: Annotated[np.ndarray, "<f8", 1]  # [N] (3), and shape [1/m] (3,3), of the last `slope`
    shape: Annotated[np.ndarray, "<f8", 2]


class Start(NamedTuple):
    """What the start of a body computes from its surfaces, for a store: it would compile four functions for it."""

    corners: np.ndarray  # (N,3) and weights (N,3) of each vertex of the fine mesh, see `lies_on`
    weights: np.ndarray
    table: np.ndarray  # [1/m] (V,V) float32, see `mean_inverse_distance`
    softness: np.ndarray  # (V,) and holding (V,3), see `Ground`
    holding: np.ndarray

    @classmethod
    def of(cls, body: CondensedBody) -> "Start":
        """The results in a body."""
        model = body.model
        return cls(model.corners, model.weights, model.true.table, body.ground.softness, body.ground.holding)

    def fits(self, coarse: int, fine: int) -> bool:
        """Whether a file has it for these numbers of vertices: kernels index it without a check."""
        try:
            check_indices(self.corners, coarse, "a vertex lies on")
        except ValueError:
            return False
        shapes = tuple(each.shape for each in self)
        return shapes == ((fine, 3), (fine, 3), (coarse, coarse), (coarse,), (coarse, 3))


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
    area: AreaLaw = FIXED,
    start: Start | None = None,
    remembers: bool = False,
) -> CondensedBody:
    """A body at rest under one contact.

    mesh      the fine surface of loads and displacements, in the same frame as `basis`
    young [Pa] > 0, retardation [s] >= 0   E, tau
    radius    [m] of the patch of the terminal law without load
    reach     [m] distance from the foot point within which all displacements are sent, fewer beyond it
    poisson   [1] of the organ under the patch; None: the compliance of the widened load is not corrected
    sticks    whether the surface under the patch sticks to the finger
    apart     [m] (V,) distance of each vertex of `basis` from a nodule, 0 under a capsule; None: the organ has neither
    rho       [1] (3,) coefficients, see `large_displacement`; empty: the organ is linear
    area      law of a contact that grows with the force; its load acts on the coarse surface on the patch of `radius`
    start     of a body with the same arguments, if it is stored
    remembers whether the correction of a former place stays with its load, as next to a gap, see `condensed_step`
    """
    coarse, fine, rho = Mesh(basis.vertices, basis.triangles), fine_mesh(mesh, radius, reach), np.array(rho)
    if start is not None and not start.fits(len(basis.vertices), len(mesh.vertices)):
        start = None
    corners, weights = lies_on(coarse, mesh) if start is None else start[:2]
    table = None if start is None else start.table
    true = without_correction(mesh) if poisson is None else true_patch(coarse, mesh, poisson, sticks, apart, table)
    if len(area.forces):
        half_space = (1.0 - true.held) * np.pi * true.normal * MEAN / young
        area, rho = with_approach(area, half_space, rho), np.array(NO_FLOATS)
    model = step.CondensedModel(
        basis.compliance, basis.vertices, rho, hat_moments(coarse), corners, weights, weight_slopes(coarse, corners),
        young, retardation, mesh.vertices, true, area, DEEPEST if apart is None or apart.any() else DEEPEST_COVERED,
        remembers,
    )  # fmt: skip
    if start is None:
        soft, _, held = softness(coarse, model, fine.spreader)
    else:
        soft, held = start.softness, start.holding
    ground = Ground(coarse.normals, soft, held, rho)
    return under(model, ground, fine, 1)


def under(model: step.CondensedModel, ground: Ground, fine: FineMesh, count: int) -> CondensedBody:
    """An organ at rest, with `count` contacts."""
    size, several = len(model.vertices), count if count > 1 else 0
    contacts = np.zeros(count, step.CONTACT_TYPE)
    contacts["course"]["ahead"] = 1.0
    return CondensedBody(
        model, ground, fine, np.zeros((count, step.FIELDS, size, 3)), np.zeros((count, 3, size), np.int64),
        contacts, np.zeros((count, 3), np.int64), np.zeros((count, 3)), np.zeros((count, 3)),
        np.eye(count), np.zeros((count, count)), np.zeros((count, 3)),
        np.zeros((several, several), KEPT_TYPE), joint_profile() if several else np.zeros(0),
        np.zeros((4, several, size)), np.zeros((2 * several, size, 3)), np.zeros((size, 3), np.float32), np.zeros(3),
        np.zeros((3, 3)),
    )  # fmt: skip


@ieee_kernel
def bear(body: CondensedBody, contact: int, nodes: Indices, forces: Matrix, foot: Vector3, normal: Vector3, dt: float):
    """Apply the load of a contact, nodal forces [N] (k,3), for a step of dt > 0 [s]. Call `answer` after all loads."""
    if len(body.model.area.forces) > 0 and len(nodes) > 0:
        patch, pull, share = respread(body.fine, forces, foot, normal)
    else:
        patch, pull, share = patch_of(body.fine, nodes, forces, foot, normal)
    for i in range(3):
        body.feet[contact, i], body.normals[contact, i] = foot[i], normal[i]
    counts = body.counts[contact]
    counts[0], counts[1] = step.take_load(
        body.model, patch, pull, share, normal, dt, body.fields[contact], body.marks[contact], body.contacts[contact],
        counts[0],
    )  # fmt: skip


@ieee_kernel
def answer(body: CondensedBody, laws: Matrix, dt: float):
    """Fill the law of each contact, compliance c [m/N] and free indentation s_free [m] of the next
    step under the patch, and current indentation s [m]; and `laws` (c,5): K, n, c, s_free and s_prev.

    The indentation is the mean of -n.u over the patch, weighted with the force, so that it is conjugate to the force.
    With large displacement c is the chord to the next step's indentation at the current force (at least `LEAST_FORCE`),
    or the tangent there if that is larger, with the corresponding s_free: force and indentation there are exact, and
    the iteration of the contact converges.
    """
    model = body.model
    if len(body.counts) == 1:
        step.add_others(model, dt, body.contacts[0], 0.0, 0.0, 0.0)
        step.with_friction(body.contacts[0])
    else:
        joint_answer(
            model, body.profile, body.fields, body.marks, body.contacts, body.counts, body.normals, body.feet,
            body.room, body.cross, body.coupling, body.drawn, body.kept, body.ground, body.vectors, dt,
        )  # fmt: skip
    for i in range(len(laws)):
        contact = body.contacts[i]
        compliance, free, now = contact.compliance, contact.free, contact.now
        laws[i, 0], laws[i, 1], laws[i, 3], laws[i, 4] = 1.0 / max(compliance, LEAST), 1.0, free, now
        if len(model.area.forces) > 0 and len(laws) == 1:
            n, force = contact.exponent, max(contact.total, step.LEAST_FORCE)
            laws[i, 0], laws[i, 1] = force * (laws[i, 0] / force) ** n, n


@kernel
def extrapolation(body: CondensedBody):
    """Excess [1] of the last step over the limits of the body: 0 within them, 1 at twice a limit."""
    most = 0.0
    for i in range(len(body.contacts)):
        for excess in step.excesses(body.contacts[i]):
            most = max(most, excess)
    return most


@kernel
def is_still(body: CondensedBody):
    """Whether all vertices are unloaded."""
    loaded = 0
    for counts in body.counts:
        loaded += counts[0]
    return loaded == 0


@ieee_kernel
def patch_energy(body: CondensedBody):
    """Energy [J] stored under the patches of the last step, V(s) of `place_energy`, of each contact in proportion to
    its part of the effective force. The load y of another organ stores y (s + t)/2: s is the displacement of its place,
    negative where other loads push that outwards, and t the part of it by friction, for y t is the work of the friction
    on the displacement by y (E. Betti 1872). For a linear body without tangential loads this is f.C f/2. The energy of
    other tangential loads and of former patches is not included."""
    if len(body.contacts) == 1 and len(body.model.area.forces) == 0:
        return _stored_under(body.model, body.contacts[0])
    total, bears = 0.0, np.empty(len(body.contacts))
    for i in range(len(bears)):
        bears[i] = body.contacts[i].course.value
    for i in range(len(bears)):
        acting = bears[i] + row_times(body.cross[i], bears) / max(body.contacts[i].self_compliance, 1e-300)
        if body.contacts[i].organ:
            now, normal = body.contacts[i].now, body.contacts[i].self_compliance * acting
            total += 0.5 * bears[i] * (now + (now - normal - body.contacts[i].recalled * bears[i]))
            continue
        if len(body.model.area.forces) > 0:
            press, own = body.contacts[0].press if len(bears) == 1 else bears[i], body.contacts[i].self_compliance
            linear = own * (acting - bears[i] + press) - step.fixed_part(body.model, body.contacts[i]) * press
            linear += body.contacts[i].recalled * press
            total += 0.5 * linear * press + approach(body.model.area.table, press)[2]
            continue
        share = bears[i] / acting if acting > 0.0 else 0.0
        total += share * _stored_under(body.model, body.contacts[i])
    return total


@ieee_kernel
def _stored_under(model: Record, contact: Record):
    now, compliance = contact.now, contact.self_compliance + contact.recalled
    if not (now > 0.0 and compliance > 0.0):
        return 0.0
    if contact.organ:
        return 0.5 * now * now / compliance
    radius = step.stretched_radius(model, contact)[0]
    return radius * radius / compliance * stored_energy(now / radius, model.rho)


@ieee_kernel
def slope(body: CondensedBody, contact: int):
    """Fill the tangential energy gradient `gradient` [N] (3) at the force of the last step, and the shape operator
    `shape` [1/m] (3,3): see `physics.bodies.place_energy`."""
    fields, one, n = body.fields[contact], body.contacts[contact], body.normals[contact]
    radius, power = step.stretched_radius(body.model, one)
    along(
        body.ground, body.marks[contact, 2], body.counts[contact, 1], fields[step.TILT], (n[0], n[1], n[2]),
        radius, power, one.self_compliance, one.total, one.press - one.more, body.gradient, body.shape,
    )  # fmt: skip
    if len(body.counts) > 1:
        for i in range(3):
            body.gradient[i] += body.drawn[contact, i]


@ieee_kernel
def displace_fine(body: CondensedBody):
    """Fill `fine.nodes`, all vertices near the last foot points and fewer farther away, and `fine.moved`, their
    displacements [m]. Returns their number, 0 if the body is at rest."""
    if is_still(body):
        return 0
    model, fine, u, normals, feet = body.model, body.fine, body.field, body.normals, body.feet
    u[:] = 0.0
    for c in range(len(feet)):
        count, touched = body.counts[c, 0], body.counts[c, 1]
        add_field(model, u, body.fields[c], body.marks[c], count, touched, normals[c], body.contacts[c])
    sent = interpolate_fine(model.corners, model.weights, u, fine.reach, feet, fine.listed, fine.nodes, fine.moved)
    for c in range(len(feet)):
        add_half_space(model, feet[c], normals[c], body.contacts[c], fine.nodes[:sent], fine.moved)
    return sent
