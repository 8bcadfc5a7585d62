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

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.physics.bodies.beam_bed_step import LEAST_COMPLIANCE, bed_step, held_together, loaded_patch, patch_between
from palpate.physics.bodies.patch import Pressed
from palpate.physics.bodies.stretch import Neighbours, StretchWorkspace, neighbours
from palpate.physics.contact.spread import spread, spreader
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.viscoelastic import ViscoelasticMaterial
from palpate.physics.materials.voigt import chain_compliance

SHORTEST_STEP = 1e-5  # [s] A shorter step is computed as this long


class FoundationBeams(NamedTuple):
    """What does not change of a bed."""

    vertices: np.ndarray  # [m] (V,3)
    normals: np.ndarray  # [1] (V,3) outward
    areas: np.ndarray  # [m²] (V)
    length: float  # [m] of all layers
    shares: np.ndarray  # [1] (h) of each layer in the length
    moduli: np.ndarray  # [Pa] (h)
    viscosities: np.ndarray  # [Pa s] (h)
    softness: float  # [m/Pa] sum of thickness over shear modulus


class Skin(NamedTuple):
    """What joins neighbours on the surface, and work space."""

    edges: Neighbours
    sideways: np.ndarray
    room: StretchWorkspace


class FoundationState(NamedTuple):
    """What a step changes.

    force [N] (V,3), weight [1] (V)   zero between steps
    nodes (V), moved [m] (V,3), place (V)   list of the displaced vertices, their displacement, place in it or -1
    """

    strains: np.ndarray  # [1] (V,h)
    displacement: np.ndarray  # [m] (V,3)
    force: np.ndarray
    weight: np.ndarray
    nodes: np.ndarray
    moved: np.ndarray
    place: np.ndarray
    chain: np.ndarray  # (h) room


class Patch(NamedTuple):
    """Vertices (V) under a contact, and their shares [1] (V) in its normal force; both filled as far as a count."""

    nodes: np.ndarray
    shares: np.ndarray


class FoundationContacts(NamedTuple):
    """What a step reads and answers of each contact.

    nodes, shares (2,c,V)  the patch that bore its last load, and the one of a load of zero
    which (c), counts (c)  the one of them that it has now, and how many vertices that has
    """

    nodes: np.ndarray
    shares: np.ndarray
    which: np.ndarray
    counts: np.ndarray
    ends: np.ndarray  # (c) of its load in the list of all
    normals: np.ndarray  # [1] (c,3) outward
    forces: np.ndarray  # [N] (c) normal force
    cross: np.ndarray  # [m/N] (c,c) compliance between patches; the diagonal is 0
    laws: np.ndarray  # (c,4) K [N/m^n], n, free and present indentation [m]
    coupling: np.ndarray  # [1] (c,c) O

    @classmethod
    def of(cls, count: int, vertices: int) -> FoundationContacts:
        which, counts, ends = np.zeros((3, count), np.int64)
        return cls(
            np.zeros((2, count, vertices), np.int32), np.zeros((2, count, vertices)), which, counts, ends,
            np.zeros((count, 3)), np.zeros(count), np.zeros((count, count)),
            np.tile([1.0 / LEAST_COMPLIANCE, 1.0, 0.0, 0.0], (count, 1)), np.eye(count),
        )  # fmt: skip


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
        self._spreader = spreader(mesh, radius)
        self.limited = 0  # Elements and vertices held at their limit in the last step
        self._under(1)
        load, state = (NO_NODES, NO_VECTORS), (self.beams, self._moving)
        self._loaded = entry_point(loaded_patch, *load, (0.0, 0.0, 0.0), self._last[0], self._moving.weight)
        self._step = entry_point(bed_step, *load, 0.0, 0, *state, self._contacts)
        self._joined = entry_point(held_together, 0, *state, self._skin)

    def _under(self, count: int) -> None:
        """Be under so many contacts, which have borne nothing yet."""
        self._contacts = own = FoundationContacts.of(count, len(self.beams.areas))
        self._last, self._between = (
            [Patch(own.nodes[which, i], own.shares[which, i]) for i in range(count)] for which in (0, 1)
        )
        self._last_counts, self._last_feet = [0] * count, [(0.0, 0.0, 0.0)] * count

    def step(self, loads: Sequence[Pressed], dt: float) -> list[tuple[float, float, float, float]]:
        """Step under the loads of all contacts; the response of the next step at each: stiffness K [N/m^n], exponent n,
        free and present indentation [m]. dt [s]; <= 0: nothing changes.

        `nodes[:count]` and `moved[:count]` are then the displaced vertices and their displacement [m], `coupling` what
        the contacts are to each other. IndexError: a node that the surface does not have.
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
        last, last_count = self._last[contact], self._last_counts[contact]
        near = math.dist(foot, self._last_feet[contact]) / self.radius if last_count else math.inf
        share = max(1.0 - near, 0.0)
        count = spread(self._spreader, foot, normal, (0.0, 0.0, 0.0)) if share < 1.0 else 0
        return patch_between(
            last, last_count, share, self._spreader.nodes[:count], self._spreader.weights[:count],
            self._between[contact], self._moving.weight,
        )  # fmt: skip


def _together(loads: Sequence[Pressed]) -> tuple[np.ndarray, np.ndarray]:
    if len(loads) == 1:
        return loads[0][0], loads[0][1]
    nodes, forces = (np.concatenate([load[k] for load in loads]) for k in (0, 1))
    nodes.setflags(write=False)
    forces.setflags(write=False)
    return nodes, forces
