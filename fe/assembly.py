"""Assembly of a body: the unbalanced force and the tangent of its elements, loads and contacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from palpate.fe.checks import checked
from palpate.fe.compiled import LAW, compiled
from palpate.fe.contact import ContactPair
from palpate.fe.elements import gradients, integrate
from palpate.fe.materials import Material
from palpate.fe.mesh import MeshError, TetMesh
from palpate.fe.tangent import Tangent


class Inverted(ArithmeticError):
    """An element is inside out at some displacement; says which and where."""


class Balance(NamedTuple):
    """Unbalanced force [N] (N,3), blocks of the tangent [N/m] (B,3,3), and the size of the inner forces [N]."""

    force: np.ndarray
    data: np.ndarray
    size: float


class Assembly:
    """A body with its materials, loads and contacts, see `fe.Solver`.

    tangent  pattern and factor
    floor    [N] residual that rounding leaves
    energy   [J] of the elements at the last evaluation

    MeshError: an element that is inside out before it is deformed.
    """

    def __init__(
        self,
        mesh: TetMesh,
        materials: Mapping[int, Material],
        fixed: np.ndarray,
        loads: Callable[[float], np.ndarray] | None,
        contacts: Sequence[ContactPair],
    ) -> None:
        self.mesh, self.fixed, self.loads, self.contacts = mesh, fixed, loads, contacts
        self.energy = 0.0
        self._groups = []
        for region in np.unique(mesh.region):
            own = np.flatnonzero(mesh.region == region)
            slope, det = gradients(mesh.points, mesh.elements[own])
            if (det <= 0).any():
                bad = own[np.argmax((det <= 0).any(axis=1))]
                raise MeshError(f"element {bad} at {mesh.place(bad)}: its edges are bent until it turns inside out")
            self._groups.append((materials[region], own, slope, det / 24.0))
        self._extra = np.zeros((0, 1), dtype=np.int64)
        self._couple()
        force, data = np.zeros_like(mesh.points), self._blocks()
        self._elements(np.zeros_like(mesh.points), force, data)
        stiffness = self.tangent.stiffness(data)
        for contact in self.contacts:
            contact.bind(mesh.points, self.tangent.pattern, stiffness)
        free = stiffness[~self.fixed.any(axis=1)]
        typical = float(np.median(free)) if len(free) else 1.0
        self.floor = 1e-13 * typical * mesh.size

    def _couple(self) -> None:
        """Pattern and elimination tree of elements and contacts."""
        mesh = self.mesh
        width = max(10, self._extra.shape[1])
        cliques = np.concatenate([_widen(mesh.elements, width), _widen(self._extra, width)])
        self.tangent = Tangent(mesh.points, cliques, self.fixed)
        where = self.tangent.pattern.where(mesh.elements)
        self._where = [where[own] for _, own, _, _ in self._groups]

    def recouple(self) -> None:
        """Widen the pattern where contacts have come to couple other nodes."""
        found = [c.couples() for c in self.contacts]
        found = [x for x in found if len(x)]
        if not found:
            return
        width = max(x.shape[1] for x in found)
        extra = np.concatenate([_widen(x, width) for x in found])
        if not np.array_equal(extra, self._extra):
            self._extra = extra
            self._couple()
        for contact in self.contacts:
            contact.couple(self.tangent.pattern)

    def _blocks(self) -> np.ndarray:
        return np.zeros((len(self.tangent.pattern.indices), 3, 3))

    def _elements(self, u: np.ndarray, force: np.ndarray, data: np.ndarray) -> tuple[float, int]:
        total = 0.0
        for (material, own, slope, weight), where in zip(self._groups, self._where, strict=True):
            energy, bad = integrate(
                compiled(material.law, LAW), slope, weight, self.mesh.elements[own], u, np.array(material.parameters),
                material.mixed, material.small, True, where, force, data,
            )  # fmt: skip
            if bad >= 0:
                return total, int(own[bad])
            total += energy
        return total, -1

    def balance(self, u: np.ndarray, load: float) -> Balance:
        """What is out of balance at a displacement.

        Inverted: an element is inside out.
        """
        force, data = np.zeros_like(u), self._blocks()
        self.energy, bad = self._elements(u, force, data)
        if bad >= 0:
            raise Inverted(f"element {bad} at {self.mesh.place(bad)} is inverted or would be")
        size = float(np.linalg.norm(force))
        if self.loads is not None:
            force -= checked("loads", self.loads(load), load, np.ones(u.shape, dtype=bool))
        for contact in self.contacts:
            contact.add(u, load, True, force, data)
        return Balance(force, data, size)

    def skew(self, change: np.ndarray) -> np.ndarray:
        """Product of a change of displacement (N,3) with what contacts leave out of the tangent."""
        force = np.zeros_like(change)
        for contact in self.contacts:
            contact.skew(change, force)
        return np.where(self.fixed, 0.0, force)


def _widen(cliques: np.ndarray, width: int) -> np.ndarray:
    return np.pad(cliques, ((0, 0), (0, width - cliques.shape[1])), constant_values=-1)
