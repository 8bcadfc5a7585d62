"""Assembly of a body: the unbalanced force and the tangent of its elements, loads and contacts."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.contact.switching import join_parts, switch_points
from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.solve.body import ElasticBody
from palpate.models.fe.solve.support import check_values
from palpate.models.fe.sparse.tangent import Tangent, join_cliques
from palpate.physics.materials.hyperelastic import Material


class Inverted(ArithmeticError):
    """An element is inverted; the message has its number and position."""


class Balance(NamedTuple):
    """Unbalanced force [N] (N,3), blocks of the tangent [N/m] (B,3,3), and the norm of the internal forces [N]."""

    force: np.ndarray
    data: np.ndarray
    size: float


class Assembly:
    """A body with its materials, loads and contacts, see `fe.Solver`.

    tangent  pattern and factor
    floor    [N] residual from rounding

    MeshError: an element is inverted in the undeformed mesh.
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
        self.body, self._extra = ElasticBody(mesh, materials), np.zeros((0, 1), dtype=np.int64)
        self._couple()
        force, data = np.zeros_like(mesh.points), self._blocks()
        self.body.add(np.zeros_like(mesh.points), force, data)
        stiffness = self.tangent.stiffness(data)
        for contact in self.contacts:
            contact.bind(mesh.points, self.tangent.pattern, stiffness)
        free = stiffness[~self.fixed.any(axis=1)]
        typical = float(np.median(free)) if len(free) else 1.0
        self.floor = 1e-13 * typical * mesh.size

    def _couple(self) -> None:
        mesh = self.mesh
        self.tangent = Tangent(mesh.points, join_cliques([mesh.elements, self._extra]), self.fixed)
        self.body.couple(self.tangent.pattern)

    def recouple(self) -> None:
        """Extend the sparsity pattern to the nodes that contacts couple now."""
        couplings = [c.couples() for c in self.contacts]
        couplings = [x for x in couplings if len(x)]
        if not couplings:
            return
        extra = join_cliques(couplings)
        if not np.array_equal(extra, self._extra):
            self._extra = extra
            self._couple()
        for contact in self.contacts:
            contact.couple(self.tangent.pattern)

    def _blocks(self) -> np.ndarray:
        return np.zeros((len(self.tangent.pattern.indices), 3, 3))

    def balance(self, u: np.ndarray, load: float) -> Balance:
        """Unbalanced force and tangent at a displacement."""
        force, data = np.zeros_like(u), self._blocks()
        _, bad = self.body.add(u, force, data)
        if bad >= 0:
            raise Inverted(f"element {bad} at {self.mesh.place(bad)} is inverted or would be")
        size = float(np.linalg.norm(force))
        if self.loads is not None:
            force -= check_values("loads", self.loads(load), load, np.ones(u.shape, dtype=bool))
        for contact in self.contacts:
            contact.add(u, load, True, force, data)
        return Balance(force, data, size)

    def switch_step(self, step: np.ndarray) -> np.ndarray:
        """Newton's step (N,3) corrected for contact points that switch during the step, see `contact.switching`."""
        switches = [(contact, contact.switching()) for contact in self.contacts]
        parts = [(contact, points) for contact, points in switches if points is not None]
        if not parts:
            return step
        free = ~self.fixed.reshape(-1, 1)
        points = join_parts([points for _, points in parts])
        right, traction = switch_points(points, step.ravel(), lambda forces: self.tangent.solve(free * forces))
        start = 0
        for contact, part in parts:
            contact.foresee(traction[start : start + len(part.level)])
            start += len(part.level)
        return right.reshape(-1, 3)

    def skew(self, change: np.ndarray) -> np.ndarray:
        """Product of a change of displacement (N,3) with the part of the contacts' tangent that `data` omits."""
        force = np.zeros_like(change)
        for contact in self.contacts:
            contact.skew(change, force)
        return np.where(self.fixed, 0.0, force)
