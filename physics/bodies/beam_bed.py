"""A bed of beams under a surface: the body that a fingertip presses, under given nodal forces.

Below each vertex of the surface stands a beam along its normal, as long as the layers are thick, with the vertex's area
as its section. Layers are Voigt elements in series (`voigt`), so a nodal force steps its beam alone, whatever the
others do. Laterally a beam is an elastic spring in shear, A / sum(L/G). Layers, and the shear of a beam, stop at the
strain limit.

The indentation that the contact sees is the one conjugate to the force: with forces w_j f on nodes that move by u_j
along the contact's inward normal, s = sum_j w_j u_j, so that f ds is exactly the work done on the beams.

Several contacts press the sum of their forces into the beams, each of which still steps alone; so contacts feel each
other where their patches share beams and nowhere else. With C_b the compliance (3,3) of a beam in its next step,

    c_ij = sum_b w_ib w_jb n_i.C_b n_j,    O_ij = c_ij/c_ii

c is symmetric and, each C_b being positive, |c_ij| <= sqrt(c_ii c_jj). The law of contact i is fitted at the force that
all of them are to it, f_i + sum_j O_ij f_j (`physics.contact.joint`).

No load is a load of zero on the patch that bore the last one: the dent that is left there is told while it recovers. As
the foot point moves away the patch passes over to the one round the foot, within `radius`.

Beams do not know of each other: dragged by a finger they would lean over their neighbours, by more than the width of
the patch where it is pressed hard, and fold the surface. What is told is therefore held together (`stretch`), and the
held vertices are counted. The beams and the law below are not changed by that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.physics.bodies.stretch import Neighbours, StretchWorkspace, hold_together, neighbours
from palpate.physics.contact.spread import Spreader
from palpate.physics.contact.terminal import LEAST_FORCE, fit_terminal
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel
from palpate.physics.materials.viscoelastic import ViscoelasticMaterial
from palpate.physics.materials.voigt import STRAIN_LIMIT, chain_compliance, chain_stress_step

NO_FORCE = 1e-9
"""[N] A force below this is none: how it is spread says nothing."""
LARGEST_FORCE = 1e6
"""[N] On a node; a larger one counts as this, so that sums stay finite."""
SHORTEST_STEP = 1e-5
"""[s] A shorter step is computed as this long."""
STILL = 1e-9
"""[1] An unloaded beam whose strains are all below this is at rest."""
MOST_APART = 0.8
"""[1] Largest difference of displacement between neighbours, over the length of their edge."""
MOST_SIDEWAYS = 0.5
"""[1] The same for the part along the surface. A triangle is turned over where that changes by 1 over its height; in a
right-angled one that is sqrt(2) of what its edges show, and the dent of a round body takes some of it."""
LEAST_COMPLIANCE = 1e-9
"""[m/N] of a patch whose layers all stand at their limit; it keeps the law finite."""


class FoundationBeams(NamedTuple):
    """What does not change of a bed.

    vertices [m] (V,3)   normals [1] (V,3) outward   areas [m²] (V)
    length   [m]         of all layers
    shares   [1] (h)     of each layer in the length   moduli [Pa] (h)   viscosities [Pa s] (h)
    softness [m/Pa]      sum of thickness over shear modulus
    """

    vertices: np.ndarray
    normals: np.ndarray
    areas: np.ndarray
    length: float
    shares: np.ndarray
    moduli: np.ndarray
    viscosities: np.ndarray
    softness: float


class Skin(NamedTuple):
    """What joins neighbours on the surface, and work space."""

    edges: Neighbours
    sideways: np.ndarray
    room: StretchWorkspace


class FoundationState(NamedTuple):
    """What a step changes.

    strains [1] (V,h)   displacement [m] (V,3)
    force [N] (V,3), weight [1] (V)   zero between steps
    nodes (V), moved [m] (V,3), place (V)   list of the displaced vertices, their displacement, place in it or -1
    chain (h)   room
    """

    strains: np.ndarray
    displacement: np.ndarray
    force: np.ndarray
    weight: np.ndarray
    nodes: np.ndarray
    moved: np.ndarray
    place: np.ndarray
    chain: np.ndarray


class Patch(NamedTuple):
    """Vertices (V) under a contact, and their shares [1] (V) in its normal force; both filled as far as a count."""

    nodes: np.ndarray
    shares: np.ndarray


class FoundationContacts(NamedTuple):
    """What a step reads and answers of each contact.

    nodes, shares (2,c,V)  the patch that bore its last load, and the one of a load of zero
    which (c), counts (c)  the one of them that it has now, and how many vertices that has
    ends    (c)            of its load in the list of all
    normals [1]   (c,3)    outward
    forces  [N]   (c)      normal force
    cross   [m/N] (c,c)    compliance between patches; the diagonal is 0
    laws          (c,4)    K [N/m^n], n, free and present indentation [m]
    coupling [1]  (c,c)    O
    """

    nodes: np.ndarray
    shares: np.ndarray
    which: np.ndarray
    counts: np.ndarray
    ends: np.ndarray
    normals: np.ndarray
    forces: np.ndarray
    cross: np.ndarray
    laws: np.ndarray
    coupling: np.ndarray

    @classmethod
    def of(cls, count: int, vertices: int) -> FoundationContacts:
        """At rest."""
        which, counts, ends = np.zeros((3, count), np.int64)
        return cls(
            np.zeros((2, count, vertices), np.int32), np.zeros((2, count, vertices)), which, counts, ends,
            np.zeros((count, 3)), np.zeros(count), np.zeros((count, count)),
            np.tile([1.0 / LEAST_COMPLIANCE, 1.0, 0.0, 0.0], (count, 1)), np.eye(count),
        )  # fmt: skip


Pressed = tuple[np.ndarray, np.ndarray, tuple[float, float, float], tuple[float, float, float]]
"""Nodes (k) and forces [N] (k,3) of a load, foot [m] (3) and outward normal [1] (3)."""


class BeamFoundation:
    """Beams under a surface, at rest.

    mesh       the surface
    hardness   [1]  (V)  a beam k times stiffer is one of k times the section; None: 1
    layers     [m]  (h)  thicknesses, > 0
    materials       (h)  one per layer
    radius     [m]       of the patch whose response is told where no force has acted

    ValueError: layers and materials that do not match, or a thickness out of range.
    """

    def __init__(
        self,
        mesh: Mesh,
        hardness: np.ndarray | None,
        layers: tuple[float, ...],
        materials: tuple[ViscoelasticMaterial, ...],
        radius: float,
    ) -> None:
        if len(layers) != len(materials) or not layers:
            raise ValueError(
                f"layers: found {len(layers)} thicknesses and {len(materials)} materials, expected as many"
            )
        if not all(0 < t < math.inf for t in layers) or not 0 < radius < math.inf:
            raise ValueError(f"layers: found {layers} m and a radius of {radius} m, expected all > 0")
        count, h = len(mesh.vertices), len(layers)
        thickness = np.array(layers, float)
        self.radius = radius
        self.beams = FoundationBeams(
            np.ascontiguousarray(mesh.vertices, float),
            np.ascontiguousarray(mesh.normals, float),
            np.ascontiguousarray(mesh.areas if hardness is None else mesh.areas * hardness, float),
            float(thickness.sum()),
            thickness / thickness.sum(),
            np.array([m.modulus for m in materials]),
            np.array([m.viscosity for m in materials]),
            float((thickness / [m.shear_modulus for m in materials]).sum()),
        )
        self._moving = FoundationState(
            np.zeros((count, h)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count),
            np.zeros(count, np.int32), np.zeros((count, 3)), np.full(count, -1, np.int64), np.zeros(h),
        )  # fmt: skip
        self._skin = Skin(neighbours(mesh), np.zeros((count, 3)), StretchWorkspace.of(count))
        self.nodes, self.moved, self.count = self._moving.nodes, self._moving.moved, 0
        self._spreader = Spreader(mesh, radius)
        self.limited = 0
        """Elements and vertices held at their limit in the last step."""
        self._under(1)
        load, state = (NO_NODES, NO_VECTORS), (self.beams, self._moving)
        self._loaded = entry_point(_loaded, *load, (0.0, 0.0, 0.0), self._last[0], self._moving.weight)
        self._step = entry_point(_bed_step, *load, 0.0, 0, *state, self._contacts)
        self._joined = entry_point(_joined, 0, *state, self._skin)

    def _under(self, count: int) -> None:
        """Be under so many contacts, which have borne nothing yet."""
        self._contacts = own = FoundationContacts.of(count, len(self.beams.areas))
        self._last, self._between = (
            [Patch(own.nodes[which, i], own.shares[which, i]) for i in range(count)] for which in (0, 1)
        )
        self._last_counts, self._last_feet = [0] * count, [(0.0, 0.0, 0.0)] * count

    def step(self, loads: Sequence[Pressed], dt: float) -> list[tuple[float, float, float, float]]:
        """Step under the loads of all contacts; the response of the next step at each: stiffness K [N/m^n], exponent n,
        free and present indentation [m].

        dt   [s]; <= 0: nothing changes

        `nodes[:count]` and `moved[:count]` are then the displaced vertices and their displacement [m], `coupling` what
        the contacts are to each other.

        IndexError: a node that the surface does not have.
        """
        if len(loads) != len(self._last):
            self._under(len(loads))
        own = self._contacts
        if dt > 0:
            for i, (nodes, forces, foot, normal) in enumerate(loads):
                touched = self._loaded(nodes, forces, normal, self._last[i], self._moving.weight)
                if touched < 0:
                    span = f"{nodes.min()} ... {nodes.max()}"
                    raise IndexError(f"found nodes {span}, the surface has {len(self.beams.areas)} vertices")
                own.which[i] = 0 if touched > 0 else 1
                if touched > 0:
                    self._last_counts[i], self._last_feet[i] = touched, foot
                else:
                    touched = self._unloaded(i, tuple(foot), tuple(normal))
                own.counts[i], own.normals[i] = touched, normal
                own.ends[i] = len(nodes) + (own.ends[i - 1] if i else 0)
            self.count, limited = self._step(
                *_together(loads), max(dt, SHORTEST_STEP), self.count, self.beams, self._moving, own
            )
            self.limited = int(limited + self._joined(self.count, self.beams, self._moving, self._skin))
        return [(stiffness, exponent, free, now) for stiffness, exponent, free, now in own.laws.tolist()]

    @property
    def coupling(self) -> np.ndarray:
        """[1] (c,c) O, see `physics.contact.joint`."""
        return self._contacts.coupling.copy()

    def relaxation(self, dt: float) -> float:
        """The one time constant [s] by which a step of dt > 0 [s] takes the share of the resting indentation that the
        layers take of it; their own have no common one."""
        beams, dt = self.beams, max(dt, SHORTEST_STEP)
        taken = chain_compliance(beams.moduli, beams.viscosities, beams.shares, dt)
        return dt * (float((beams.shares / beams.moduli).sum()) / taken - 1.0)

    def _unloaded(self, contact: int, foot: tuple, normal: tuple) -> int:
        """Fill the patch of a load of zero; its length."""
        last, last_count = self._last[contact], self._last_counts[contact]
        near = math.dist(foot, self._last_feet[contact]) / self.radius if last_count else math.inf
        share = max(1.0 - near, 0.0)
        count = self._spreader.spread(foot, normal, (0.0, 0.0, 0.0)) if share < 1.0 else 0
        return _between(
            last, last_count, share, self._spreader.nodes[:count], self._spreader.weights[:count],
            self._between[contact], self._moving.weight,
        )  # fmt: skip


def _together(loads: Sequence[Pressed]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and forces of all loads in one list, of the type of one."""
    if len(loads) == 1:
        return loads[0][0], loads[0][1]
    nodes, forces = (np.concatenate([load[k] for load in loads]) for k in (0, 1))
    nodes.setflags(write=False)
    forces.setflags(write=False)
    return nodes, forces


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _held(force):
    return min(max(force, -LARGEST_FORCE), LARGEST_FORCE)


@kernel
def _loaded(nodes, forces, normal, patch, weight):
    """Fill the patch with the shares of a load in its normal force; its length. 0, and the patch as it was, where there
    is no such force; -1 where the surface does not have a node."""
    total = 0.0
    for k in range(nodes.shape[0]):
        if not 0 <= nodes[k] < weight.shape[0]:
            return -1
        total += _push(forces[k], normal)
    if not total > NO_FORCE:
        return 0
    for k in range(nodes.shape[0]):
        weight[nodes[k]] += _push(forces[k], normal)
    count = 0
    for k in range(nodes.shape[0]):
        count = _collect(nodes[k], 1.0 / total, patch, weight, count)
    return count


@kernel
def _push(force, normal):
    return -(_held(force[0]) * normal[0] + _held(force[1]) * normal[1] + _held(force[2]) * normal[2])


@kernel
def _between(last, last_count, share, nodes, weights, patch, weight):
    """Fill the patch between the one that bore the last load, of this share, and another; its length."""
    for k in range(last_count):
        weight[last.nodes[k]] += share * last.shares[k]
    for k in range(nodes.shape[0]):
        weight[nodes[k]] += (1.0 - share) * weights[k]
    count = 0
    for k in range(last_count):
        count = _collect(last.nodes[k], 1.0, patch, weight, count)
    for k in range(nodes.shape[0]):
        count = _collect(nodes[k], 1.0, patch, weight, count)
    return count


@kernel
def _collect(j, scale, patch, weight, count):
    if weight[j] != 0.0:
        patch.nodes[count], patch.shares[count] = j, scale * weight[j]
        weight[j] = 0.0
        count += 1
    return count


@kernel
def _bed_step(nodes, forces, dt, count, beams, moving, contacts):
    """Step the beams under all loads and take the law on the patch of each contact; how many vertices are displaced,
    and how many beams are at a limit."""
    force, active, place, displacement = moving.force, moving.nodes, moving.place, moving.displacement
    for k in range(nodes.shape[0]):
        j = nodes[k]
        if place[j] < 0:
            place[j] = count
            active[count] = j
            count += 1
        for a in range(3):
            force[j, a] += _held(forces[k, a])
    limited = 0.0
    for k in range(count):
        limited += _beam(active[k], dt, beams, moving)
    start = 0
    for i in range(len(contacts.forces)):
        total = 0.0
        for k in range(start, contacts.ends[i]):
            total += _push(forces[k], contacts.normals[i])
        start = contacts.ends[i]
        contacts.forces[i] = total if total > NO_FORCE else 0.0
        for j in range(i):
            contacts.cross[i, j] = contacts.cross[j, i] = _shared(i, j, dt, beams, moving, contacts)
    for i in range(len(contacts.forces)):
        _response(i, dt, beams, moving, contacts)
    for k in range(nodes.shape[0]):
        force[nodes[k], :] = 0.0
    kept = 0
    for k in range(count):
        j = active[k]
        still = displacement[j, 0] == 0.0 and displacement[j, 1] == 0.0 and displacement[j, 2] == 0.0
        if still:
            place[j] = -1
        else:
            active[kept], place[j] = j, kept
            moving.moved[kept] = displacement[j]
            kept += 1
    return kept, limited


@kernel
def _joined(count, beams, moving, skin):
    """Limit the displacement that is sent: along the surface, then as a whole; how many vertices were limited."""
    moved, sideways = moving.moved, skin.sideways
    for k in range(count):
        normal = beams.normals[moving.nodes[k]]
        along = _dot(moved[k], normal)
        for a in range(3):
            sideways[k, a] = moved[k, a] - along * normal[a]
            moved[k, a] -= sideways[k, a]
    held = hold_together(sideways, count, MOST_SIDEWAYS, skin.edges, moving.place, moving.nodes, skin.room)
    for k in range(count):
        for a in range(3):
            moved[k, a] += sideways[k, a]
    return max(held, hold_together(moved, count, MOST_APART, skin.edges, moving.place, moving.nodes, skin.room))


@kernel
def _beam(j, dt, beams, moving):
    """Step one beam under its force; 1 where an element is at its limit."""
    force, strains, displacement, normal = moving.force[j], moving.strains[j], moving.displacement[j], beams.normals[j]
    along = _dot(force, normal)
    push = max(-along, 0.0)
    loaded = force[0] != 0.0 or force[1] != 0.0 or force[2] != 0.0
    strain = chain_stress_step(strains, beams.moduli, beams.viscosities, beams.shares, push / beams.areas[j], dt)
    most = 0.0
    for a in range(strains.shape[0]):
        most = max(most, strains[a])
    if most < STILL and not loaded:
        strains[:] = 0.0
        displacement[:] = 0.0
        return 0.0
    held = _shear_left(force, along, beams.softness / beams.areas[j], beams.length)
    for a in range(3):
        tangent = force[a] - along * normal[a]
        displacement[a] = held * beams.softness * tangent / beams.areas[j] - strain * beams.length * normal[a]
    return 1.0 if most >= STRAIN_LIMIT or held < 1.0 else 0.0


@kernel
def _shear_left(force, along, softness, length):
    """The share [1] of the free sideways displacement softness |f_t| [m] that the limit of the shear leaves."""
    sideways = softness * math.sqrt(max(_dot(force, force) - along * along, 0.0))
    limit = STRAIN_LIMIT * length
    return 1.0 if sideways <= limit else limit / sideways


@kernel
def _shared(i, j, dt, beams, moving, contacts):
    """Compliance [m/N] between the patches of two contacts, by the beams that both have; not below 0, as little as
    leaning beams could be."""
    n, m, weight = contacts.normals[i], contacts.normals[j], moving.weight
    first, second = contacts.which[i], contacts.which[j]
    for k in range(contacts.counts[j]):
        weight[contacts.nodes[second, j, k]] = contacts.shares[second, j, k]
    total = 0.0
    for k in range(contacts.counts[i]):
        v = contacts.nodes[first, i, k]
        w = contacts.shares[first, i, k] * weight[v]
        if w == 0.0:
            continue
        area, beam, force = beams.areas[v], beams.normals[v], moving.force[v]
        here, there, along = _dot(beam, n), _dot(beam, m), _dot(force, beam)
        moving.chain[:] = moving.strains[v]
        chain_stress_step(moving.chain, beams.moduli, beams.viscosities, beams.shares, max(-along, 0.0) / area, dt)
        axial = beams.length * _chain_compliance(moving.chain, beams, dt)
        side = _shear_left(force, along, beams.softness / area, beams.length) * beams.softness
        total += w / area * (max(here, 0.0) * max(there, 0.0) * axial + side * (_dot(n, m) - here * there))
    for k in range(contacts.counts[j]):
        weight[contacts.nodes[second, j, k]] = 0.0
    return max(total, 0.0)


@kernel
def _chain_compliance(strains, beams, dt):
    """d strain / d stress [1/Pa] of a step that ends at these strains; elements at their limit give no more."""
    total = 0.0
    for a in range(beams.moduli.shape[0]):
        if beams.shares[a] > 0.0 and strains[a] < STRAIN_LIMIT:
            total += beams.shares[a] / (beams.moduli[a] + beams.viscosities[a] / dt)
    return total


@kernel
def _response(i, dt, beams, moving, contacts):
    """The law of the next step, of the same length, at the present forces: K, n, free and present indentation; and what
    the others are at this contact."""
    normal, which, total = contacts.normals[i], contacts.which[i], contacts.forces[i]
    others = 0.0
    for j in range(len(contacts.forces)):
        others += contacts.cross[i, j] * contacts.forces[j]
    loaded = total > 0.0 or others > 0.0
    free = deep = previous = compliance = 0.0
    length, shares, moduli, viscosities = beams.length, beams.shares, beams.moduli, beams.viscosities
    chain = moving.chain
    for k in range(contacts.counts[i]):
        j, w = contacts.nodes[which, i, k], contacts.shares[which, i, k]
        area, beam, strains, force = beams.areas[j], beams.normals[j], moving.strains[j], moving.force[j]
        face = _dot(beam, normal)
        previous -= w * _dot(moving.displacement[j], normal)
        chain[:] = strains
        free += w * face * length * chain_stress_step(chain, moduli, viscosities, shares, 0.0, dt)
        chain[:] = strains
        along = _dot(force, beam)
        push = max(-along, 0.0) if loaded else max(face, 0.0) * w * LEAST_FORCE
        deep += w * face * length * chain_stress_step(chain, moduli, viscosities, shares, push / area, dt)
        held = _shear_left(force, along, beams.softness / area, length)
        side = held * w * beams.softness / area * (1.0 - face * face)
        if loaded:
            deep -= held * w * beams.softness / area * (_dot(force, normal) - along * face)
        else:
            deep += w * LEAST_FORCE * side
        compliance += w * side
        for a in range(moduli.shape[0]):
            if shares[a] > 0.0 and chain[a] < STRAIN_LIMIT:
                rate = viscosities[a] / dt
                compliance += w * w * face * max(face, 0.0) * length * shares[a] / (moduli[a] + rate) / area
    compliance = max(compliance, LEAST_COMPLIANCE)
    acting = total + others / compliance
    least = max(acting, LEAST_FORCE)
    if loaded and acting < least:
        # Lighter than the least force: the linear response, carried up to it.
        deep = free + (deep - free) * least / acting
    slope = 1.0 / compliance
    law = contacts.laws[i]
    law[0], law[1] = fit_terminal(free, max(deep, free + least / slope), slope, least)
    law[2], law[3] = free, previous
    for j in range(len(contacts.forces)):
        contacts.coupling[i, j] = 1.0 if i == j else contacts.cross[i, j] / compliance
