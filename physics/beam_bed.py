"""A bed of beams under a surface: the body that a fingertip presses, under given nodal forces.

Below each vertex of the surface stands a beam along its normal, as long as the layers are thick, with the vertex's area
as its section. Layers are Voigt elements in series (`voigt`), so a nodal force steps its beam alone, whatever the
others do. Laterally a beam is an elastic spring in shear, A / sum(L/G). Layers, and the shear of a beam, stop at the
strain limit.

The indentation that the contact sees is the one conjugate to the force: with forces w_j f on nodes that move by u_j
along the contact's inward normal, s = sum_j w_j u_j, so that f ds is exactly the work done on the beams.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from palpate.physics.materials import Material
from palpate.physics.terminal import LEAST_FORCE, fit_terminal
from palpate.physics.voigt import STRAIN_LIMIT, chain_stress_step

NO_FORCE = 1e-9
"""[N] A force below this is none: how it is spread says nothing."""
LARGEST_FORCE = 1e6
"""[N] On a node; a larger one counts as this, so that sums stay finite."""
SHORTEST_STEP = 1e-5
"""[s] A shorter step is computed as this long."""
STILL = 1e-9
"""[1] An unloaded beam whose strains are all below this is at rest."""
LEAST_COMPLIANCE = 1e-9
"""[m/N] of a patch whose layers all stand at their limit; it keeps the law finite."""


class Bed:
    """Beams under a surface, at rest.

    normals    [1]  (V,3)  outward, of the vertices        areas [m²] (V)  of the vertices
    layers     [m]  (h)    thicknesses, > 0                materials (h)   one per layer
    radius     [m]         of the patch whose response is told while no force acts

    ValueError: layers and materials that do not match, or a thickness out of range.
    """

    def __init__(
        self, vertices, normals, areas, layers: tuple[float, ...], materials: tuple[Material, ...], radius: float
    ) -> None:
        if len(layers) != len(materials) or not layers:
            raise ValueError(
                f"layers: found {len(layers)} thicknesses and {len(materials)} materials, expected as many"
            )
        if not all(0 < t < math.inf for t in layers) or not 0 < radius < math.inf:
            raise ValueError(f"layers: found {layers} m and a radius of {radius} m, expected all > 0")
        self.vertices, self.normals = np.ascontiguousarray(vertices, float), np.ascontiguousarray(normals, float)
        self.areas = np.ascontiguousarray(areas, float)
        count = len(self.vertices)
        thickness = np.array(layers, float)
        self.length = float(thickness.sum())
        self.shares = thickness / self.length
        self.moduli = np.array([m.modulus for m in materials])
        self.viscosities = np.array([m.viscosity for m in materials])
        self.softness = float((thickness / [m.shear_modulus for m in materials]).sum())
        self.radius = radius
        self.strains = np.zeros((count, len(layers)))
        self.displacement = np.zeros((count, 3))
        self.nodes = np.zeros(count, dtype=np.int32)
        self.moved = np.zeros((count, 3))
        self.count = 0
        self._place = np.full(count, -1, dtype=np.int64)
        self._force = np.zeros((count, 3))
        self._weight = np.zeros(count)
        self._chain = np.zeros(len(layers))
        self._law = np.zeros(6)
        # A patch at rest: a biweight load of radius R acts as if on an area of pi R² / 1.8.
        compliance = 1.8 * self.length * float((self.shares / self.moduli).sum()) / (math.pi * radius**2)
        self._rest = np.array([1 / compliance, 1.0, 0.0, 0.0, 0.0, 0.0])
        self._law[:] = self._rest
        self._fixed = (
            self.vertices, self.normals, self.areas, self.length, self.shares, self.moduli, self.viscosities,
            self.softness, self.radius, self.strains, self.displacement, self.nodes, self.moved, self._place,
            self._force, self._weight, self._chain, self._law, self._rest,
        )  # fmt: skip

    def step(self, nodes, forces, foot, normal, dt: float) -> tuple[float, ...]:
        """Step under nodal forces; the response of the next step: stiffness K [N/m^n], exponent n, free and present
        indentation [m], elements at their limit, force [N].

        nodes [1] (k) int   forces [N] (k,3)   foot [m] (3)   normal [1] (3) outward   dt [s]; <= 0: nothing changes

        `nodes[:count]` and `moved[:count]` are then the displaced vertices and their displacement [m].

        IndexError: a node that the surface does not have.
        """
        if dt > 0:
            count = _bed_step(nodes, forces, foot, normal, max(dt, SHORTEST_STEP), self.count, *self._fixed)
            if count < 0:
                found = f"{nodes.min()} ... {nodes.max()}"
                raise IndexError(f"found nodes {found}, the surface has {len(self.vertices)} vertices")
            self.count = count
        return tuple(self._law.tolist())


@numba.njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _held(force):
    return min(max(force, -LARGEST_FORCE), LARGEST_FORCE)


@numba.njit(cache=True)
def _bed_step(
    nodes, forces, foot, normal, dt, count, vertices, normals, areas, length, shares, moduli, viscosities, softness,
    radius, strains, displacement, active, moved, place, force, weight, chain, law, rest,
):  # fmt: skip
    for k in range(nodes.shape[0]):
        if not 0 <= nodes[k] < vertices.shape[0]:
            return -1
    law[:] = rest
    total = 0.0
    for k in range(nodes.shape[0]):
        j = nodes[k]
        if place[j] < 0:
            place[j] = count
            active[count] = j
            count += 1
        for a in range(3):
            force[j, a] += _held(forces[k, a])
            total -= _held(forces[k, a]) * normal[a]
    total = total if total > NO_FORCE else 0.0
    share = _weights(nodes, forces, foot, normal, vertices, areas, radius, total, weight)

    clamped = 0.0
    for k in range(count):
        clamped += _beam(
            active[k], dt, normals, areas, length, shares, moduli, viscosities, softness, strains, displacement, force
        )
    _response(
        nodes, normal, dt, normals, areas, length, shares, moduli, viscosities, softness, strains, displacement,
        force, weight, share, total, chain, law,
    )  # fmt: skip
    law[4], law[5] = clamped, total
    for k in range(nodes.shape[0]):
        force[nodes[k], :] = 0.0
        weight[nodes[k]] = 0.0
    kept = 0
    for k in range(count):
        j = active[k]
        still = displacement[j, 0] == 0.0 and displacement[j, 1] == 0.0 and displacement[j, 2] == 0.0
        if still:
            place[j] = -1
        else:
            active[kept], place[j] = j, kept
            moved[kept] = displacement[j]
            kept += 1
    return kept


@numba.njit(cache=True)
def _weights(nodes, forces, foot, normal, vertices, areas, radius, total, weight):
    """Shares of the normal force on the loaded nodes; without force, those of a biweight load. False: no node."""
    sum_ = 0.0
    for k in range(nodes.shape[0]):
        sum_ += _part(k, nodes, forces, foot, normal, vertices, areas, radius, total)
    if sum_ <= 0.0:
        return False
    for k in range(nodes.shape[0]):
        weight[nodes[k]] += _part(k, nodes, forces, foot, normal, vertices, areas, radius, total) / sum_
    return True


@numba.njit(cache=True)
def _part(k, nodes, forces, foot, normal, vertices, areas, radius, total):
    if total > 0.0:
        return -(_held(forces[k, 0]) * normal[0] + _held(forces[k, 1]) * normal[1] + _held(forces[k, 2]) * normal[2])
    j = nodes[k]
    x, y, z = vertices[j, 0] - foot[0], vertices[j, 1] - foot[1], vertices[j, 2] - foot[2]
    q = max(1.0 - (x * x + y * y + z * z) / (radius * radius), 0.0)
    return areas[j] * q * q


@numba.njit(cache=True)
def _beam(j, dt, normals, areas, length, shares, moduli, viscosities, softness, strains, displacement, force):
    """Step one beam under its force; 1 where an element is at its limit."""
    push = max(-_dot(force[j], normals[j]), 0.0)
    loaded = force[j, 0] != 0.0 or force[j, 1] != 0.0 or force[j, 2] != 0.0
    strain = chain_stress_step(strains[j], moduli, viscosities, shares, push / areas[j], dt)
    most = 0.0
    for a in range(moduli.shape[0]):
        most = max(most, strains[j, a])
    if most < STILL and not loaded:
        strains[j, :] = 0.0
        displacement[j, :] = 0.0
        return 0.0
    along = _dot(force[j], normals[j])
    held = _shear_left(force[j], along, softness / areas[j], length)
    for a in range(3):
        tangent = force[j, a] - along * normals[j, a]
        displacement[j, a] = held * softness * tangent / areas[j] - strain * length * normals[j, a]
    return 1.0 if most >= STRAIN_LIMIT or held < 1.0 else 0.0


@numba.njit(cache=True)
def _shear_left(force, along, softness, length):
    """The share [1] of the free sideways displacement softness |f_t| [m] that the limit of the shear leaves."""
    sideways = softness * math.sqrt(max(_dot(force, force) - along * along, 0.0))
    limit = STRAIN_LIMIT * length
    return 1.0 if sideways <= limit else limit / sideways


@numba.njit(cache=True)
def _response(
    nodes, normal, dt, normals, areas, length, shares, moduli, viscosities, softness, strains, displacement, force,
    weight, share, total, chain, law,
):  # fmt: skip
    """The law of the next step, of the same length, at the present force: K, n, free and present indentation."""
    if not share:
        return
    free = deep = previous = compliance = 0.0
    least = max(total, LEAST_FORCE)
    for k in range(nodes.shape[0]):
        j = nodes[k]
        w = weight[j]
        weight[j] = 0.0
        if w == 0.0:
            continue
        face = _dot(normals[j], normal)
        previous -= w * _dot(displacement[j], normal)
        chain[:] = strains[j]
        free += w * face * length * chain_stress_step(chain, moduli, viscosities, shares, 0.0, dt)
        chain[:] = strains[j]
        push = max(face, 0.0) * w * least
        if total > 0.0:
            push = max(-_dot(force[j], normals[j]), 0.0)
        deep += w * face * length * chain_stress_step(chain, moduli, viscosities, shares, push / areas[j], dt)
        held = _shear_left(force[j], _dot(force[j], normals[j]), softness / areas[j], length)
        side = held * w * softness / areas[j] * (1.0 - face * face)
        if total > 0.0:
            deep -= held * w * softness / areas[j] * (_dot(force[j], normal) - _dot(force[j], normals[j]) * face)
        else:
            deep += w * least * side
        compliance += w * side
        for a in range(moduli.shape[0]):
            if shares[a] > 0.0 and chain[a] < STRAIN_LIMIT:
                rate = viscosities[a] / dt
                compliance += w * w * face * max(face, 0.0) * length * shares[a] / (moduli[a] + rate) / areas[j]
        weight[j] = 0.0
    if total > 0.0 and total < least:
        # Lighter than the least force: the linear response, carried up to it.
        deep = free + (deep - free) * least / total
    slope = 1.0 / max(compliance, LEAST_COMPLIANCE)
    law[0], law[1] = fit_terminal(free, max(deep, free + least / slope), slope, least)
    law[2], law[3] = free, previous
