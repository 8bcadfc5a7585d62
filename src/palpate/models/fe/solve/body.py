"""An elastic body: elements in groups of one material, elastic foundations, and walls that push on each other."""

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.contact.walls import Walls
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.elements import gradients, integrate
from palpate.models.fe.element.mesh import MeshError, TetMesh
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.sparse.condensation import condense
from palpate.models.fe.sparse.tangent import Pattern, Tangent, join_cliques, pattern
from palpate.physics.materials.compiled import compile_law, law_signature
from palpate.physics.materials.hyperelastic import Material

ORDERED, FACTORED = 0.5, 0.75  # parts of the time of `compliance` after which the order and the factor are known


class ElementGroup(NamedTuple):
    """Elements of one material."""

    material: Material
    elements: np.ndarray  # (G,) their numbers
    slope: np.ndarray  # [1/m] (G,n,10,3) gradients of the shape functions
    weight: np.ndarray  # [m³] (G,n) of the integration points


class ElasticBody:
    """Elements, each with the material of its region, and linear supports.

    materials  by region number;  supports  elastic foundations, and walls that are near each other

    MeshError: an element is inverted in the undeformed mesh.
    """

    def __init__(
        self, mesh: TetMesh, materials: Mapping[int, Material], supports: Sequence[ElasticFoundation | Walls] = ()
    ) -> None:
        self.mesh, self.supports = mesh, list(supports)
        self.groups: list[ElementGroup] = []
        for region in np.unique(mesh.region).tolist():
            elements = np.flatnonzero(mesh.region == region)
            slope, det = gradients(mesh.points, mesh.elements[elements])
            if (det <= 0).any():
                bad = elements[np.argmax((det <= 0).any(axis=1))]
                raise MeshError(
                    f"element {bad} at {mesh.place(bad)}: its edges are so curved that its Jacobian is negative"
                )
            self.groups.append(ElementGroup(materials[region], elements, slope, det / 24.0))
        self._where: list[np.ndarray] = []
        for support in self.supports:
            support.bind(mesh.points, self.pattern, np.zeros(0))
            support.couple(self.pattern)

    @cached_property
    def cliques(self) -> np.ndarray:
        """Nodes that are coupled (C,k), padded with -1: by each element, and by each pair of near walls."""
        return join_cliques([self.mesh.elements, *(support.couples() for support in self.supports)])

    @cached_property
    def pattern(self) -> Pattern:
        """Sparsity pattern of the tangent."""
        sparsity = pattern(len(self.mesh.points), self.cliques)
        self.couple(sparsity)
        return sparsity

    def couple(self, wider: Pattern) -> None:
        """Use a pattern that contains that of the elements in `add`."""
        where = wider.where(self.mesh.elements)
        self._where = [where[group.elements] for group in self.groups]

    def add(self, u: np.ndarray, force: np.ndarray, data: np.ndarray | None = None) -> tuple[float, int]:
        """Energy [J] of the elements at displacements [m] (N,3) and the number of an inverted element, or -1.

        Adds their forces to `force` [N] (N,3) and their tangent to the blocks `data` (B,3,3) of the pattern, if given.
        """
        total, tangent = 0.0, data is not None
        blocks = np.zeros((0, 3, 3)) if data is None else data
        for k, (material, elements, slope, weight) in enumerate(self.groups):
            where = self._where[k] if tangent else np.zeros((0, 10, 10), dtype=np.int64)
            energy, bad = integrate(
                compile_law(material.law, law_signature()), slope, weight, self.mesh.elements[elements], u,
                np.array(material.parameters), material.mixed, material.small, tangent, where, force, blocks,
            )  # fmt: skip
            if bad >= 0:
                return total, int(elements[bad])
            total += energy
        return total, -1

    def balance(self, u: np.ndarray, data: np.ndarray | None = None) -> tuple[float, np.ndarray] | None:
        """Energy [J] and internal forces [N] (N,3) of elements and foundations at displacements [m] (N,3).

        Adds their tangent to the blocks `data` of the pattern, if given. None: an element is inverted.
        """
        force, springs = np.zeros_like(u), np.zeros_like(u)
        energy, bad = self.add(u, force, data)
        if bad >= 0:
            return None
        for support in self.supports:
            support.add(u, 0.0, data is not None, springs, np.zeros((0, 3, 3)) if data is None else data)
        return energy + 0.5 * float(np.sum(springs * u)), force + springs

    def tangent(self, u: np.ndarray) -> np.ndarray:
        """Blocks (B,3,3) of the tangent at displacements [m] (N,3), with foundations."""
        data = np.zeros((len(self.pattern.indices), 3, 3))
        self.balance(u, data)
        return data

    def forces(self, u: np.ndarray) -> np.ndarray | None:
        """Internal forces [N] (N,3) at displacements [m] (N,3), with foundations; None: an element is inverted."""
        balance = self.balance(u)
        return None if balance is None else balance[1]

    def rest(self, fixed: np.ndarray) -> Tangent:
        """The factored tangent at rest, with displacement components (N,3) bool fixed."""
        tangent = Tangent(self.mesh.points, self.cliques, fixed)
        tangent.factor(self.tangent(np.zeros_like(self.mesh.points)))
        return tangent

    def compliance(self, fixed: np.ndarray, hats: np.ndarray, report: Report = unheard) -> np.ndarray:
        """Mean displacement over each hat for a unit force on each hat [m/N] (3V,3V), symmetric positive definite."""
        tangent = Tangent(self.mesh.points, self.cliques, fixed)
        report(ORDERED)
        tangent.factor(self.tangent(np.zeros_like(self.mesh.points)))
        report(FACTORED)

        def condensing(done: float) -> None:
            report(FACTORED + (1.0 - FACTORED) * done)

        return condense(tangent.factored, csr_array(hats), ~fixed, condensing)

    def digest(self) -> bytes:
        """Hash of all inputs of its forces."""
        hasher = hashlib.sha256()
        for law, elements, slope, weight in self.groups:
            hasher.update(repr((law.name, law.parameters, law.mixed, law.small)).encode())
            for part in (elements, slope, weight):
                hasher.update(np.ascontiguousarray(part).tobytes())
        for support in self.supports:
            hasher.update(support.inputs())
        for part in (self.mesh.points, self.mesh.elements):
            hasher.update(np.ascontiguousarray(part).tobytes())
        return hasher.digest()


def hats(mesh: TetMesh, faces: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Nodal loads (N,V) of a unit force per corner (V,), distributed over its faces (F,6) by a hat function."""
    areas = face_rule.areas(mesh.points, faces)
    share = np.einsum("fq,qc,qa->fca", areas, face_rule.HATS, face_rule.VALUES)
    column = np.full(len(mesh.points), -1)
    column[corners] = np.arange(len(corners))
    loads = np.zeros((len(mesh.points), len(corners)))
    np.add.at(loads, (faces[:, None, :], column[faces[:, :3]][:, :, None]), share)
    return loads / loads.sum(axis=0)
