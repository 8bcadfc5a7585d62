"""A held body and the surface that it is touched on: what a reduction needs to know of a model."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from palpate.fe import faces as face_rule
from palpate.fe.bed import Bed
from palpate.fe.compiled import LAW, compiled
from palpate.fe.elements import gradients, integrate
from palpate.fe.fingertip import BONE, DERMIS, EPIDERMIS, NAIL, SUBCUTIS, Fingertip, materials
from palpate.fe.materials import Material
from palpate.fe.mesh import TetMesh
from palpate.fe.organ import Organ
from palpate.fe.pattern import Pattern, pattern
from palpate.fe.solver import DEFAULT, Settings, Solver
from palpate.fe.tangent import Tangent
from palpate.physics.mesh import Mesh

SUBCUTIS_MODULUS = 6.0 * (300.0 + 671.0)
"""[Pa] Young's modulus at rest of the literal subcutis, 6 (c10 + c01): the finger's modulus E; its other layers
are stiffer in proportion. Calibrated it is E = 160 Pa."""


@dataclass
class Reducible:
    """A body whose moduli scale with one number; of 1 Pa unless another is given.

    materials  modulus [Pa] -> law of each region
    fixed      (N,3) bool, displacements that are zero
    surface    V vertices and triangles, in the body's frame
    hats       (N,V) nodal loads of a unit force spread round each vertex of the surface
    beds       modulus [Pa] -> what it lies on
    """

    mesh: TetMesh
    materials: Callable[[float], dict[int, Material]]
    fixed: np.ndarray
    surface: Mesh
    hats: np.ndarray
    beds: Callable[[float], list[Bed]] = lambda young: []

    @cached_property
    def digest(self) -> bytes:
        """A hash of all that its answers depend on."""
        found = hashlib.sha256()
        for law, own, slope, weight in self.groups:
            found.update(repr((law.law.__name__, law.parameters, law.mixed, law.small)).encode())
            for part in (own, slope, weight):
                found.update(np.ascontiguousarray(part).tobytes())
        for bed in self.springs:
            found.update(repr(bed.stiffness).encode() + np.ascontiguousarray(bed.faces).tobytes())
        for part in (self.mesh.points, self.mesh.elements, self.fixed, self.hats):
            found.update(np.ascontiguousarray(part).tobytes())
        return found.digest()

    @cached_property
    def springs(self) -> list[Bed]:
        """What it lies on."""
        found = self.beds(1.0)
        for bed in found:
            bed.bind(self.mesh.points, self.pattern, np.zeros(0))
        return found

    @cached_property
    def pattern(self) -> Pattern:
        """Of its tangent."""
        return pattern(len(self.mesh.points), self.mesh.elements)

    @cached_property
    def groups(self) -> list[tuple[Material, np.ndarray, np.ndarray, np.ndarray]]:
        """Elements of each material: material, indices, gradients of the shape functions, weights of the points."""
        found, laws = [], self.materials(1.0)
        for region in np.unique(self.mesh.region).tolist():
            own = np.flatnonzero(self.mesh.region == region)
            slope, det = gradients(self.mesh.points, self.mesh.elements[own])
            found.append((laws[region], own, slope, det / 24.0))
        return found

    def tangent(self, u: np.ndarray) -> np.ndarray:
        """Blocks (B,3,3) of the tangent at displacements [m] (N,3), springs included."""
        data, force = np.zeros((len(self.pattern.indices), 3, 3)), np.zeros_like(u)
        where = self.pattern.where(self.mesh.elements)
        for law, own, slope, weight in self.groups:
            integrate(
                compiled(law.law, LAW), slope, weight, self.mesh.elements[own], u, np.array(law.parameters), law.mixed,
                law.small, True, where[own], force, data,
            )  # fmt: skip
        for bed in self.springs:
            bed.add(u, 0.0, True, force, data)
        return data

    def forces(self, u: np.ndarray) -> np.ndarray | None:
        """Inner forces [N] (N,3) at displacements [m] (N,3), springs included; None where an element is inverted."""
        force, nothing, blocks = np.zeros_like(u), np.zeros((0, 10, 10), dtype=np.int64), np.zeros((0, 3, 3))
        for law, own, slope, weight in self.groups:
            _, bad = integrate(
                compiled(law.law, LAW), slope, weight, self.mesh.elements[own], u, np.array(law.parameters), law.mixed,
                law.small, False, nothing, force, blocks,
            )  # fmt: skip
            if bad >= 0:
                return None
        for bed in self.springs:
            bed.add(u, 0.0, False, force, blocks)
        return force

    def rest(self) -> Tangent:
        """The tangent at rest, factored."""
        found = Tangent(self.mesh.points, self.mesh.elements, self.fixed)
        found.factor(self.tangent(np.zeros_like(self.mesh.points)))
        return found

    def compliance(self, report: Callable[[float], None] | None = None) -> np.ndarray:
        """Displacement under each vertex of the surface (mean under its hat) for a unit force on each [m/N] (3V,3V)."""
        solver = self.rest()
        count = self.hats.shape[1]
        found = np.empty((count, 3, count, 3))
        for start in range(0, count, 16):
            part = self.hats[:, start : start + 16]
            size = part.shape[1]
            rhs = np.zeros((len(self.hats), 3, size, 3))
            for axis in range(3):
                rhs[:, axis, :, axis] = part
            rhs[self.fixed] = 0.0
            u = solver.solve(rhs.reshape(3 * len(self.hats), -1)).reshape(len(self.hats), 3, size, 3)
            u[self.fixed] = 0.0
            found[:, :, start : start + size] = np.einsum("nv,niwj->viwj", self.hats, u, optimize=True)
            if report is not None:
                report((start + size) / count)
        full = found.reshape(3 * count, 3 * count)
        return 0.5 * (full + full.T)

    def solver(self, young: float, loads: Callable[[float], np.ndarray], settings: Settings = DEFAULT) -> Solver:
        """The full model of a modulus [Pa] under nodal loads [N], see `fe.Solver`."""
        return Solver(
            self.mesh, self.materials(young), self.fixed, loads=loads, contacts=self.beds(young), settings=settings
        )


def of_organ(organ: Organ) -> Reducible:
    """An organ on its bed."""

    def beds(young: float) -> list[Bed]:
        return [Bed(organ.faces[organ.under()], organ.bed * young)]

    free = np.zeros(organ.mesh.points.shape, dtype=bool)
    return Reducible(organ.mesh, organ.materials, free, organ.surface, organ.hats(), beds)


def of_finger(finger: Fingertip) -> Reducible:
    """The soft layers of the fingertip, pulp up, tip towards +y, origin on its axis where the rounded tip begins.

    Both halves; held at the bone, at the rear and under the nail. The bone is far stiffer than the pulp: held or
    meshed, the pulp's indentation differs by less than 1e-3 of itself up to 0.5 N.
    """
    half = finger.mesh
    away = np.abs(half.points[:, 0]) > 1e-9
    count = len(half.points)
    other = np.arange(count)
    other[away] = count + np.arange(away.sum())
    points = np.concatenate([half.points, half.points[away] * (-1.0, 1.0, 1.0)])
    turned = half.elements[:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]  # a mirrored element with two corners swapped
    region = np.tile(half.region, 2)
    whole = TetMesh(_own_frame(finger, points), np.concatenate([half.elements, other[turned]]), region)
    held = np.concatenate([finger.held, finger.held[away]])
    held[np.unique(whole.elements[region == BONE])] = True
    faces = whole.boundary(np.flatnonzero(region != NAIL))
    rear = (whole.points[faces[:, :3], 1] < -finger.phalanx * (1.0 - 1e-6)).all(axis=1)
    soft = np.isin(region, (SUBCUTIS, DERMIS, EPIDERMIS))
    nodes, elements = np.unique(whole.elements[soft], return_inverse=True)
    number = np.full(len(points), -1)
    number[nodes] = np.arange(len(nodes))
    mesh = TetMesh(whole.points[nodes], elements.reshape(-1, 10), region[soft])
    skin = number[faces[~rear]]
    corners, triangles = np.unique(skin[:, :3], return_inverse=True)
    surface = Mesh(mesh.points[corners], triangles.reshape(-1, 3).astype(np.int32))
    fixed = np.repeat(held[nodes][:, None], 3, axis=1)

    def laws(young: float) -> dict[int, Material]:
        return {region: replace(law, mixed=False) for region, law in materials(SUBCUTIS_MODULUS / young).items()}

    return Reducible(mesh, laws, fixed, surface, _hats(mesh, skin, corners))


def _own_frame(finger: Fingertip, points: np.ndarray) -> np.ndarray:
    """From the frame of `Fingertip`, plate below and tilted, to the finger's own."""
    s, c = np.sin(finger.tilt), np.cos(finger.tilt)
    up, forward = np.array([0.0, c, -s]), np.array([0.0, s, c])
    lowest = np.array([0.0, 0.0, finger.phalanx]) - finger.radii[-1] * up
    across = np.outer(points[:, 0], (1.0, 0.0, 0.0))
    there = across + np.outer(points[:, 2], up) - np.outer(points[:, 1], forward) + lowest
    return np.stack([there[:, 0], there[:, 2] - finger.phalanx, -there[:, 1]], axis=1)


def _hats(mesh: TetMesh, faces: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Nodal loads (N,V) of a unit force spread over the faces round each corner, highest there."""
    x, y = face_rule.POINTS.T
    hat = np.stack([1.0 - x - y, x, y], axis=1)
    value, _ = face_rule.shape(face_rule.POINTS)
    share = np.einsum("fq,qc,qa->fca", face_rule.areas(mesh.points, faces), hat, value)
    column = np.full(len(mesh.points), -1)
    column[corners] = np.arange(len(corners))
    loads = np.zeros((len(mesh.points), len(corners)))
    np.add.at(loads, (faces[:, None, :], column[faces[:, :3]][:, :, None]), share)
    return loads / loads.sum(axis=0)
