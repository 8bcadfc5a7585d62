"""A bed of beams under a surface: the body that a fingertip presses, under given nodal forces.

Below each vertex of the surface stands a beam along its normal, as long as the layers are thick, with the vertex's area
as its section. Layers are Voigt elements in series (`voigt`), so a nodal force steps its beam alone. Laterally a beam
is an elastic spring in shear, A / sum(L/G). Layers, and the shear of a beam, stop at the strain limit.

The indentation that the contact sees is the one conjugate to the force: with forces w_j f on nodes that move by u_j
along the contact's inward normal, s = sum_j w_j u_j, so that f ds is exactly the work done on the beams.

Several contacts press the sum of their forces into the beams; so they feel each other where their patches share beams.
With C_b the compliance (3,3) of a beam in its next step,

    c_ij = sum_b w_ib w_jb n_i.C_b n_j,    O_ij = c_ij/c_ii

c is symmetric and, each C_b being positive, |c_ij| <= sqrt(c_ii c_jj). The law of contact i is fitted at the force that
all of them are to it, f_i + sum_j O_ij f_j (`physics.contact.joint`).

No load is a load of zero on the patch that bore the last one: the dent that is left there is told while it recovers. As
the foot point moves away the patch passes over to the one round the foot, within `radius`. The displacement that is
told is held together (`stretch`), as beams do not know of each other; beams and law are not changed by that.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from palpate.physics.bodies.beam_bed_step import (
    LEAST_COMPLIANCE,
    add_forces,
    bed_step,
    held_together,
    loaded_patch,
    patch_between,
)
from palpate.physics.bodies.stretch import Neighbours, StretchWorkspace, neighbours
from palpate.physics.contact.spread import Spreader, spread, spreader
from palpate.physics.exact import distance
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel
from palpate.physics.materials.viscoelastic import ViscoelasticMaterial
from palpate.physics.materials.voigt import chain_compliance

SHORTEST_STEP = 1e-5  # [s] A shorter step is computed as this long


class FoundationBeams(NamedTuple):
    """What does not change of a bed."""

    vertices: Annotated[np.ndarray, "<f8", 2]  # [m] (V,3)
    normals: Annotated[np.ndarray, "<f8", 2]  # [1] (V,3) outward
    areas: Annotated[np.ndarray, "<f8", 1]  # [m²] (V)
    length: float  # [m] of all layers
    shares: Annotated[np.ndarray, "<f8", 1]  # [1] (h) of each layer in the length
    moduli: Annotated[np.ndarray, "<f8", 1]  # [Pa] (h)
    viscosities: Annotated[np.ndarray, "<f8", 1]  # [Pa s] (h)
    softness: float  # [m/Pa] sum of thickness over shear modulus
    static: float  # [1/Pa] compliance of all layers at rest, over their length


class Skin(NamedTuple):
    """What joins neighbours on the surface, and work space."""

    edges: Neighbours
    sideways: Annotated[np.ndarray, "<f8", 2]
    room: StretchWorkspace


class FoundationState(NamedTuple):
    """What a step changes.

    force [N] (V,3), weight [1] (V)   zero between steps
    nodes (V), moved [m] (V,3), place (V)   list of the displaced vertices, their displacement, place in it or -1
    told (2)   how many of these there are, and how many elements and vertices were held at their limit
    """

    strains: Annotated[np.ndarray, "<f8", 2]  # [1] (V,h)
    displacement: Annotated[np.ndarray, "<f8", 2]  # [m] (V,3)
    force: Annotated[np.ndarray, "<f8", 2]
    weight: Annotated[np.ndarray, "<f8", 1]
    nodes: Annotated[np.ndarray, "<i4", 1]
    moved: Annotated[np.ndarray, "<f8", 2]
    place: Annotated[np.ndarray, "<i8", 1]
    chain: Annotated[np.ndarray, "<f8", 1]  # (h) room
    told: Annotated[np.ndarray, "<i8", 1]


class Patch(NamedTuple):
    """Vertices (V) under a contact, and their shares [1] (V) in its normal force; both filled as far as a count."""

    nodes: Annotated[np.ndarray, "<i4", 1]
    shares: Annotated[np.ndarray, "<f8", 1]


class FoundationContacts(NamedTuple):
    """What a step reads and answers of each contact.

    nodes, shares (2,c,V)  the patch that bore its last load, and the one of a load of zero
    which (c), counts (c)  the one of them that it has now, and how many vertices that has
    borne (c), feet [m] (c,3)  how many vertices bore its last load, and round which point
    """

    nodes: Annotated[np.ndarray, "<i4", 3]
    shares: Annotated[np.ndarray, "<f8", 3]
    which: Annotated[np.ndarray, "<i8", 1]
    counts: Annotated[np.ndarray, "<i8", 1]
    borne: Annotated[np.ndarray, "<i8", 1]
    feet: Annotated[np.ndarray, "<f8", 2]
    normals: Annotated[np.ndarray, "<f8", 2]  # [1] (c,3) outward
    forces: Annotated[np.ndarray, "<f8", 1]  # [N] (c) normal force
    cross: Annotated[np.ndarray, "<f8", 2]  # [m/N] (c,c) compliance between patches; the diagonal is 0
    laws: Annotated[np.ndarray, "<f8", 2]  # (c,5) K [N/m^n], n, c, free and present indentation [m]
    coupling: Annotated[np.ndarray, "<f8", 2]  # [1] (c,c) O


def foundation_contacts(count: int, vertices: int) -> FoundationContacts:
    """Of so many contacts, which have borne nothing yet."""
    which, counts, borne = np.zeros((3, count), np.int64)
    return FoundationContacts(
        np.zeros((2, count, vertices), np.int32), np.zeros((2, count, vertices)), which, counts, borne,
        np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count), np.zeros((count, count)),
        np.tile([1.0 / LEAST_COMPLIANCE, 1.0, 0.0, 0.0, 0.0], (count, 1)), np.eye(count),
    )  # fmt: skip


class BeamFoundation(NamedTuple):
    """Beams under a surface, and their state."""

    beams: FoundationBeams
    moving: FoundationState
    skin: Skin
    spreader: Spreader  # of the patch whose response is told where no force has acted
    radius: float  # [m] of that patch
    contacts: FoundationContacts


def beam_foundation(
    mesh: Mesh,
    hardness: np.ndarray | None,
    layers: tuple[float, ...],
    materials: tuple[ViscoelasticMaterial, ...],
    radius: float,
    contacts: int = 1,
) -> BeamFoundation:
    """Beams at rest.

    mesh       the surface
    hardness   [1]  (V)  a beam k times stiffer is one of k times the section; None: 1
    layers     [m]  (h)  thicknesses, > 0
    materials       (h)  one per layer
    radius     [m]       of the patch whose response is told where no force has acted

    ValueError: layers and materials that do not match, or a thickness out of range.
    """
    if len(layers) != len(materials) or not layers:
        raise ValueError(f"layers: found {len(layers)} thicknesses and {len(materials)} materials, expected as many")
    if not all(0 < t < math.inf for t in layers) or not 0 < radius < math.inf:
        raise ValueError(f"layers: found {layers} m and a radius of {radius} m, expected all > 0")
    count, h = len(mesh.vertices), len(layers)
    thickness, moduli = np.array(layers, float), np.array([m.modulus for m in materials])
    shares = thickness / thickness.sum()
    beams = FoundationBeams(
        np.ascontiguousarray(mesh.vertices, float),
        np.ascontiguousarray(mesh.normals, float),
        np.ascontiguousarray(mesh.areas if hardness is None else mesh.areas * hardness, float),
        float(thickness.sum()),
        shares,
        moduli,
        np.array([m.viscosity for m in materials]),
        float((thickness / [m.shear_modulus for m in materials]).sum()),
        float((shares / moduli).sum()),
    )
    moving = FoundationState(
        np.zeros((count, h)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count), np.zeros(count, np.int32),
        np.zeros((count, 3)), np.full(count, -1, np.int64), np.zeros(h), np.zeros(2, np.int64),
    )  # fmt: skip
    skin = Skin(neighbours(mesh), np.zeros((count, 3)), StretchWorkspace.of(count))
    return BeamFoundation(beams, moving, skin, spreader(mesh, radius), radius, foundation_contacts(contacts, count))


@kernel(error_model="numpy")
def bear(bed, contact, nodes, forces, foot, normal):
    """Take the load of a contact, nodal forces [N] (k,3) on vertices of the surface; `answer` follows for all."""
    own, moving = bed.contacts, bed.moving
    last = Patch(own.nodes[0, contact], own.shares[0, contact])
    touched = loaded_patch(nodes, forces, normal, last, moving.weight)
    own.which[contact] = 0 if touched > 0 else 1
    if touched > 0:
        own.borne[contact] = touched
        own.feet[contact, 0], own.feet[contact, 1], own.feet[contact, 2] = foot
    else:
        near = distance(foot, own.feet[contact]) / bed.radius if own.borne[contact] > 0 else math.inf
        share = max(1.0 - near, 0.0)
        count = spread(bed.spreader, foot, normal, (0.0, 0.0, 0.0)) if share < 1.0 else 0
        touched = patch_between(
            last, own.borne[contact], share, bed.spreader.nodes[:count], bed.spreader.weights[:count],
            Patch(own.nodes[1, contact], own.shares[1, contact]), moving.weight,
        )  # fmt: skip
    own.counts[contact] = touched
    own.normals[contact, 0], own.normals[contact, 1], own.normals[contact, 2] = normal
    moving.told[0], own.forces[contact] = add_forces(nodes, forces, normal, moving.told[0], moving)


@kernel(error_model="numpy")
def answer(bed, dt):
    """Step the beams by dt > 0 [s] under the loads of all contacts: fills the laws of the next step, `coupling`, what
    the contacts are to each other, and `told`, of how many of `nodes` and `moved` the displacement [m] is sent."""
    told, dt = bed.moving.told, max(dt, SHORTEST_STEP)
    told[0], limited = bed_step(dt, told[0], bed.beams, bed.moving, bed.contacts)
    told[1] = int(limited + held_together(told[0], bed.beams, bed.moving, bed.skin))


@kernel(error_model="numpy")
def relaxation(beams, dt):
    """The one time constant [s] by which a step of dt > 0 [s] takes the share of the resting indentation that the
    layers take of it; their own have no common one."""
    dt = max(dt, SHORTEST_STEP)
    return dt * (beams.static / chain_compliance(beams.moduli, beams.viscosities, beams.shares, dt) - 1.0)
