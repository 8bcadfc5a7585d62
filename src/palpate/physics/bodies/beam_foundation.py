"""An elastic foundation of beams under a surface: the tissue that a fingertip presses, under given nodal forces.

Each vertex of the surface has a beam along its normal, with the thickness of all layers as its length and the vertex's
area as its section. Layers are Voigt elements in series (`voigt`), so beams are independent. Laterally a beam is one
Voigt element in shear, of the stiffness A / sum(L/G) and the retardation `SHEAR_LAG` x sum(tau L/G) / sum(L/G), the
mean of the layers. (Elastic shear indents inclined beams at once under friction, while their fingertip is viscous: the
force of two fingers on one place, or of one in a groove, then alternated.) The strain of the layers and the shear of a
beam are limited.

The indentation s of a contact is conjugate to its force f: with forces w_j f on nodes that move by u_j along the inward
normal, s = sum_j w_j u_j, so that f ds is the work done on the beams.

Several contacts are coupled by the beams that their patches share. With the compliance C_b (3,3) of a beam in its next
step,

    c_ij = sum_b w_ib w_jb n_i.C_b n_j,    O_ij = c_ij/c_ii

c is symmetric and, as each C_b is positive, |c_ij| <= sqrt(c_ii c_jj). The law of contact i is fitted at the effective
force f_i + sum_j O_ij f_j (`physics.contact.joint`).

Friction r_j f_j of contact j indents the patch of i by m_ij f_j, m_ij = -sum_b w_ib w_jb n_i.C_b r_j, one step after it
acts. When one of two fingers on the same beams takes over the force of the other, their indentations hardly change,
c_ii + c_jj - 2 c_ij ~ 0, so that friction decides, and with laws that know c only the forces alternated by 1 N from
step to step. So each law is softer by d_ij = max(|m_ij|, |m_ji|), C + D with D_ii = sum_j d_ij. It passes through the
present state, and an error of the forces becomes (C + D)^-1 (D - M) times as large in the next step (for stiff
fingertips): as C and D - (M + M^T)/2 are positive semidefinite, no eigenvalue has a real part below 0.

A missing load is a load of zero on the last patch, whose indentation is reported while it recovers. When the foot point
moves away, this patch is blended into the one round the foot, over the distance `MERGES` x `radius`. As the beams are
independent, the displacement that is sent is limited (`stretch`); beams and law are not affected.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.exact import distance
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Indices, Matrix, Vector3
from palpate.physics.bodies import beam_foundation_step as stepping
from palpate.physics.bodies.stretch import Neighbours, StretchWorkspace, neighbours
from palpate.physics.contact.spread import Spreader, spread, spreader
from palpate.physics.geometry.felt.bearing import Bearing
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.voigt import ViscoelasticMaterial, chain_compliance

MERGES = 0.125
"""[1] A patch this part of the radius away is indented by 97 % of the indentation under the load. A longer blend
includes the indentation of another place, so that a finger touches too late and then too deep."""
SHEAR_LAG = 1.0 / 3.0
"""[1] Retardation in shear over the mean of the layers: assumed, between two limits that are known. A viscosity of the
change of shape alone retards shear as it does compression, 1: then a patch that rolls over a rim meets tissue that has
not yielded in the new direction (up to 1.7 times the force that depth, rate and roll explain). One of the change of
volume alone, as of a fluid that is pressed out, does not retard shear, 0: then friction indents inclined beams at once.
See docs/your_organ.md."""
SHORTEST_STEP = 1e-5  # [s] A shorter step is computed as this long


class FoundationBeams(NamedTuple):
    """Constants of a foundation."""

    vertices: Annotated[np.ndarray, "<f8", 2]  # [m] (V,3)
    normals: Annotated[np.ndarray, "<f8", 2]  # [1] (V,3) outward
    areas: Annotated[np.ndarray, "<f8", 1]  # [m²] (V)
    length: float  # [m] of all layers
    shares: Annotated[np.ndarray, "<f8", 1]  # [1] (h) of each layer in the length
    moduli: Annotated[np.ndarray, "<f8", 1]  # [Pa] (h)
    viscosities: Annotated[np.ndarray, "<f8", 1]  # [Pa s] (h)
    softness: float  # [m/Pa] sum of thickness over shear modulus
    lag: float  # [s] retardation in shear
    static: float  # [1/Pa] compliance of all layers at rest, over their length


class Skin(NamedTuple):
    """Edges of the surface, and workspace, to limit the displacement that is sent."""

    edges: Neighbours
    sideways: Annotated[np.ndarray, "<f8", 2]
    room: StretchWorkspace
    shortest: float  # [m] edge of the surface


class FoundationState(NamedTuple):
    """State of a foundation.

    force [N] (V,3), weight [1] (V)   zero between steps
    nodes (V), moved [m] (V,3), place (V)   displaced vertices, their displacement, and index of a vertex in them or -1
    sent (2)   their number, and the number of elements and vertices at their limit
    """

    strains: Annotated[np.ndarray, "<f8", 2]  # [1] (V,h)
    displacement: Annotated[np.ndarray, "<f8", 2]  # [m] (V,3)
    force: Annotated[np.ndarray, "<f8", 2]
    weight: Annotated[np.ndarray, "<f8", 1]
    nodes: Annotated[np.ndarray, "<i4", 1]
    moved: Annotated[np.ndarray, "<f8", 2]
    place: Annotated[np.ndarray, "<i8", 1]
    chain: Annotated[np.ndarray, "<f8", 1]  # (h) workspace
    sent: Annotated[np.ndarray, "<i8", 1]


class Patch(NamedTuple):
    """Vertices (V) under a contact and their shares [1] (V) in its normal force; the first `count` are used."""

    nodes: Annotated[np.ndarray, "<i4", 1]
    shares: Annotated[np.ndarray, "<f8", 1]


class FoundationContacts(NamedTuple):
    """State and results of each contact.

    nodes, shares (2,c,V)  two patches: 0 of its last load, 1 of a load of zero
    which (c), counts (c)  number of the current patch, 0 or 1, and its number of vertices
    borne (c), feet [m] (c,3)  number of vertices and foot point of the last load
    """

    nodes: Annotated[np.ndarray, "<i4", 3]
    shares: Annotated[np.ndarray, "<f8", 3]
    which: Annotated[np.ndarray, "<i8", 1]
    counts: Annotated[np.ndarray, "<i8", 1]
    borne: Annotated[np.ndarray, "<i8", 1]
    feet: Annotated[np.ndarray, "<f8", 2]
    normals: Annotated[np.ndarray, "<f8", 2]  # [1] (c,3) outward
    forces: Annotated[np.ndarray, "<f8", 1]  # [N] (c) normal force
    rubs: Annotated[np.ndarray, "<f8", 2]  # [1] (c,3) friction over the normal force
    cross: Annotated[np.ndarray, "<f8", 2]  # [m/N] (c,c) compliance between patches; the diagonal is 0
    rubbed: Annotated[np.ndarray, "<f8", 1]  # [m/N] (c) D_ii
    laws: Annotated[np.ndarray, "<f8", 2]  # (c,5) K [N/m^n], n, c, free and current indentation [m]
    coupling: Annotated[np.ndarray, "<f8", 2]  # [1] (c,c) O


def foundation_contacts(count: int, vertices: int) -> FoundationContacts:
    """The initial state of `count` contacts."""
    which, counts, borne = np.zeros((3, count), np.int64)
    return FoundationContacts(
        np.zeros((2, count, vertices), np.int32), np.zeros((2, count, vertices)), which, counts, borne,
        np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count), np.zeros((count, 3)), np.zeros((count, count)),
        np.zeros(count), np.tile([1.0 / stepping.LEAST_COMPLIANCE, 1.0, 0.0, 0.0, 0.0], (count, 1)), np.eye(count),
    )  # fmt: skip


class BeamFoundation(NamedTuple):
    """Beams under a surface, and their state."""

    beams: FoundationBeams
    moving: FoundationState
    skin: Skin
    spreader: Spreader  # of the patch of a contact that has not been loaded
    radius: float  # [m] of that patch
    contacts: FoundationContacts


def beam_foundation(
    mesh: Mesh,
    hardness: np.ndarray | None,
    layers: tuple[float, ...],
    materials: tuple[ViscoelasticMaterial, ...],
    radius: float,
    contacts: int = 1,
    bearing: Bearing | None = None,
) -> BeamFoundation:
    """Beams at rest.

    mesh       the surface
    hardness   [1]  (V)  factor on the stiffness, as a factor on the section, of each beam; None: 1
    layers     [m]  (h)  thicknesses, > 0
    materials       (h)  one per layer
    radius     [m]       of the patch of a contact that has not been loaded
    bearing              the part of the surface that bears load; None: all of it

    ValueError: layers and materials that do not match, or a thickness out of range.
    """
    if len(layers) != len(materials) or not layers:
        raise ValueError(f"layers: found {len(layers)} thicknesses and {len(materials)} materials, expected as many")
    if not all(0 < t < math.inf for t in layers) or not 0 < radius < math.inf:
        raise ValueError(f"layers: found {layers} m and a radius of {radius} m, expected all > 0")
    # layers in series, each with its share of the length
    count, h = len(mesh.vertices), len(layers)
    thickness, moduli = np.array(layers, float), np.array([m.modulus for m in materials])
    shares, soft = thickness / thickness.sum(), thickness / np.array([m.shear_modulus for m in materials])
    areas, normals = (mesh.areas, mesh.normals) if bearing is None else (bearing.sections(mesh), bearing.normals)
    areas = areas if hardness is None else areas * hardness
    vertices, normals, areas = (np.ascontiguousarray(x, float) for x in (mesh.vertices, normals, areas))
    beams = FoundationBeams(
        vertices, normals, areas, float(thickness.sum()), shares, moduli, np.array([m.viscosity for m in materials]),
        float(soft.sum()), SHEAR_LAG * float((soft * [m.viscosity / m.modulus for m in materials]).sum() / soft.sum()),
        float((shares / moduli).sum()),
    )  # fmt: skip
    # at rest, out of contact
    moving = FoundationState(
        np.zeros((count, h)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count), np.zeros(count, np.int32),
        np.zeros((count, 3)), np.full(count, -1, np.int64), np.zeros(h), np.zeros(2, np.int64),
    )  # fmt: skip
    edges = neighbours(mesh)
    skin = Skin(edges, np.zeros((count, 3)), StretchWorkspace.of(count), float(edges.spans.min(initial=math.inf)))
    return BeamFoundation(
        beams, moving, skin, spreader(mesh, radius, bearing=bearing), radius, foundation_contacts(contacts, count)
    )


@ieee_kernel
def bear(foundation: BeamFoundation, contact: int, nodes: Indices, forces: Matrix, foot: Vector3, normal: Vector3):
    """Apply the load of a contact, nodal forces [N] (k,3) on vertices of the surface. Call `answer` after all loads."""
    contacts, moving = foundation.contacts, foundation.moving
    last = Patch(contacts.nodes[0, contact], contacts.shares[0, contact])
    touched = stepping.loaded_patch(nodes, forces, normal, last, moving.weight)
    contacts.which[contact] = 0 if touched > 0 else 1
    if touched > 0:
        contacts.borne[contact] = touched
        contacts.feet[contact, 0], contacts.feet[contact, 1], contacts.feet[contact, 2] = foot
    else:
        away = distance(foot, contacts.feet[contact]) if contacts.borne[contact] > 0 else math.inf
        share = max(1.0 - away / (MERGES * foundation.radius), 0.0)
        spreader = foundation.spreader
        count = spread(spreader, foot, normal, (0.0, 0.0, 0.0)) if share < 1.0 else 0
        touched = stepping.patch_between(
            last, contacts.borne[contact], share, spreader.nodes[:count], spreader.weights[:count],
            Patch(contacts.nodes[1, contact], contacts.shares[1, contact]), moving.weight,
        )  # fmt: skip
    contacts.counts[contact] = touched
    contacts.normals[contact, 0], contacts.normals[contact, 1], contacts.normals[contact, 2] = normal
    moving.sent[0], contacts.forces[contact] = stepping.add_forces(
        nodes, forces, normal, moving.sent[0], moving, contacts.rubs[contact]
    )


@ieee_kernel
def answer(foundation: BeamFoundation, dt: float):
    """Step the beams by dt > 0 [s] under the loads of all contacts: fills the laws of the next step, `coupling`, and
    `nodes` and `moved` up to the first number of `sent`."""
    sent, dt = foundation.moving.sent, max(dt, SHORTEST_STEP)
    sent[0], limited = stepping.foundation_step(dt, sent[0], foundation.beams, foundation.moving, foundation.contacts)
    sent[1] = int(limited + stepping.limit_displacement(sent[0], foundation.beams, foundation.moving, foundation.skin))


@ieee_kernel
def relaxation(beams: FoundationBeams, dt: float):
    """Effective time constant [s] of the layers for a step of dt > 0 [s]: a single Voigt element with it approaches
    its rest by the same fraction."""
    dt = max(dt, SHORTEST_STEP)
    return dt * (beams.static / chain_compliance(beams.moduli, beams.viscosities, beams.shares, dt) - 1.0)
