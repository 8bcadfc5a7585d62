"""Static equilibrium of a soft body in load steps: Newton with line search, steps cut back where they fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from palpate.fe.cholesky import Cholesky, NotPositive
from palpate.fe.compiled import LAW, compiled
from palpate.fe.elements import gradients, integrate
from palpate.fe.materials import Material
from palpate.fe.mesh import MeshError, TetMesh
from palpate.fe.pattern import Pattern, pattern


class ConvergenceError(ArithmeticError):
    """A load step that fails however small; says where and what was reached. The solver keeps that state."""


class ContactPair(Protocol):
    """What the solver needs of a contact, see `fe.rigid`."""

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None: ...
    def couple(self, pattern: Pattern) -> None: ...
    def couples(self) -> np.ndarray: ...
    def begin(self, displacement: np.ndarray, load: float) -> None: ...
    def back(self) -> None: ...
    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: Any, data: Any) -> None: ...
    def settle(self) -> bool: ...
    def state(self) -> dict[str, Any]: ...
    def restore(self, state: dict[str, Any]) -> None: ...


@dataclass(frozen=True)
class Settings:
    """How the load is stepped and when an iteration has converged.

    tolerance   [1] residual over the greatest of reaction, contact and inner forces
    iterations  Newton iterations of one load step before it is cut back
    step        load of the first step; it grows to `largest` where Newton converges fast
    least       load step below which the solver gives up
    """

    tolerance: float = 1e-6
    iterations: int = 40
    step: float = 0.1
    largest: float = 0.25
    least: float = 1e-4


DEFAULT = Settings()


class Solver:
    """A body with materials, supports and contacts; `advance` carries it to a load.

    mesh       quadratic tetrahedra
    materials  by region number
    fixed      (N,3) bool, displacement components that are prescribed
    held       load -> prescribed displacement [m] (N,3), read where fixed; zero by default
    loads      load -> outer nodal forces [N] (N,3); none by default
    contacts   see `fe.rigid`

    Load is a number that the functions give a meaning; it starts at 0.
    """

    def __init__(
        self,
        mesh: TetMesh,
        materials: Mapping[int, Material],
        fixed: np.ndarray,
        held: Callable[[float], np.ndarray] | None = None,
        loads: Callable[[float], np.ndarray] | None = None,
        contacts: Sequence[ContactPair] = (),
        settings: Settings = DEFAULT,
    ) -> None:
        missing = sorted(set(mesh.region.tolist()) - set(materials))
        if missing:
            raise MeshError(f"regions {missing} have no material; materials are given for {sorted(materials)}")
        if fixed.shape != mesh.points.shape:
            raise ValueError(f"fixed: found shape {fixed.shape}, expected {mesh.points.shape}")
        self.mesh, self.materials, self.settings = mesh, dict(materials), settings
        self.contacts = list(contacts)
        self.held, self.loads = held, loads
        self.load = 0.0
        self.displacement = np.zeros_like(mesh.points)
        self.reaction = np.zeros_like(mesh.points)
        self.energy = 0.0
        self.factorisations = self.iterations = 0
        self._last: tuple[float, np.ndarray] | None = None
        loose = np.ones(len(mesh.points), dtype=bool)
        loose[mesh.elements] = False
        self.fixed = fixed | loose[:, None]
        self._groups = []
        for region in np.unique(mesh.region):
            own = np.flatnonzero(mesh.region == region)
            slope, det = gradients(mesh.points, mesh.elements[own])
            if (det <= 0).any():
                bad = own[np.argmax((det <= 0).any(axis=1))]
                raise MeshError(f"element {bad} at {_place(mesh, bad)}: its edges are bent until it turns inside out")
            self._groups.append((self.materials[region], own, slope, det / 24.0))
        self._extra = np.zeros((0, 1), dtype=np.int64)
        self._couple()
        force, data = np.zeros_like(mesh.points), np.zeros((len(self._pattern.indices), 3, 3))
        self._elements(self.displacement, True, force, data)
        stiffness = np.trace(data[self._diagonal], axis1=1, axis2=2) / 3.0
        for contact in self.contacts:
            contact.bind(mesh.points, self._pattern, stiffness)
        free = stiffness[~self.fixed.any(axis=1)]
        typical = float(np.median(free)) if len(free) else 1.0
        self._floor = 1e-13 * typical * mesh.size

    def _couple(self) -> None:
        """Pattern and elimination tree of elements and contacts."""
        mesh = self.mesh
        width = max(10, self._extra.shape[1])
        cliques = np.concatenate([_widen(mesh.elements, width), _widen(self._extra, width)])
        self._pattern = pattern(len(mesh.points), cliques)
        where = self._pattern.where(mesh.elements)
        self._where = [where[own] for _, own, _, _ in self._groups]
        self._diagonal = self._pattern.where(np.arange(len(mesh.points))[:, None])[:, 0, 0]
        self._solver = Cholesky(mesh.points, self._pattern.indptr, self._pattern.indices)

    def _recouple(self) -> None:
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
            contact.couple(self._pattern)

    def _elements(self, u: np.ndarray, tangent: bool, force: np.ndarray, data: np.ndarray) -> tuple[float, int]:
        total = 0.0
        for (material, own, slope, weight), where in zip(self._groups, self._where, strict=True):
            energy, bad = integrate(
                compiled(material.law, LAW), slope, weight, self.mesh.elements[own], u, np.array(material.parameters),
                material.mixed, material.small, tangent, where, force, data,
            )  # fmt: skip
            if bad >= 0:
                return total, int(own[bad])
            total += energy
        return total, -1

    def _residual(self, u: np.ndarray, load: float, tangent: bool) -> tuple[np.ndarray, np.ndarray, float, int]:
        """Unbalanced force (N,3), blocks of the tangent, size of the forces at work, and the first bad element."""
        force = np.zeros_like(u)
        data = np.zeros((len(self._pattern.indices) if tangent else 0, 3, 3))
        self.energy, bad = self._elements(u, tangent, force, data)
        if bad >= 0:
            return force, data, 0.0, bad
        size = float(np.linalg.norm(force))
        if self.loads is not None:
            force -= self.loads(load)
        for contact in self.contacts:
            contact.add(u, load, tangent, force, data)
        return force, data, size, -1

    def advance(self, load: float, report: Callable[[float], None] | None = None) -> None:
        """Carry the body to this load in as many steps as it takes; `report` hears the load after each.

        ConvergenceError: a step of the least size fails; the last converged state is kept.
        """
        step = min(self.settings.step, abs(load - self.load))
        while abs(load - self.load) > 1e-12 * max(1.0, abs(load)):
            left = load - self.load
            target = load if abs(left) < 1.01 * step else self.load + np.copysign(step, left)
            fault, used = self._try(target)
            if fault is None:
                if used <= 8:
                    step = min(1.5 * step, self.settings.largest)
                if report is not None:
                    report(self.load)
                continue
            step = 0.5 * abs(target - self.load)
            if step < self.settings.least:
                raise ConvergenceError(
                    f"load step from {self.load:.6g} to {target:.6g}: {fault}. The state at load {self.load:.6g} is "
                    "kept. A finer mesh where it fails, a smaller load or stiffer material would help"
                )

    def _try(self, load: float) -> tuple[str | None, int]:
        """One load step: None, or why it failed; and the iterations used."""
        for contact in self.contacts:
            contact.begin(self.displacement, self.load)
        self._recouple()
        fault, used, u = self._newton(load)
        self.iterations += used
        if fault is None:
            self._last = load - self.load, u - self.displacement
            self.displacement, self.load = u, load
        else:
            self._last = None
            for contact in self.contacts:
                contact.back()
        return fault, used

    def _newton(self, load: float) -> tuple[str | None, int, np.ndarray]:
        u = self.displacement.copy()
        goal = np.zeros_like(u) if self.held is None else np.asarray(self.held(load), dtype=np.float64)
        bad = 0
        if self._last is not None:  # go on as the last step went
            guess = np.where(self.fixed, goal, u + (load - self.load) / self._last[0] * self._last[1])
            force, data, size, bad = self._residual(guess, load, True)
            if bad < 0:
                u = guess
        if bad >= 0:
            force, data, size, bad = self._residual(u, load, True)
        if bad >= 0:
            return f"element {bad} at {_place(self.mesh, bad)} is inverted", 0, u
        jump = np.where(self.fixed, goal - u, 0.0)
        pending = bool(np.abs(jump).max(initial=0.0) > 0.0)
        used = since = 0
        while True:
            if pending:
                pull = (self._pattern.matrix(data) @ jump.ravel()).reshape(-1, 3)
            else:
                pull = 0.0
                rest = np.where(self.fixed, 0.0, force)
                error = float(np.linalg.norm(rest))
                scale = max(size, float(np.linalg.norm(force)), self._floor / self.settings.tolerance)
                if not np.isfinite(error):
                    return "a force is not finite", used, u
                if error <= self.settings.tolerance * scale:
                    if all([contact.settle() for contact in self.contacts]):
                        self.reaction = np.where(self.fixed, force, 0.0)
                        return None, used, u
                    force, data, size, bad = self._residual(u, load, True)
                    since = 0
                    if used >= self.settings.iterations:
                        return f"penetration stays above its bound after {used} iterations", used, u
                    rest = np.where(self.fixed, 0.0, force)
            if since >= self.settings.iterations:
                worst = int(np.argmax(np.linalg.norm(rest, axis=1)))
                return (
                    f"no convergence in {since} iterations, residual {error / scale:.2g} of the forces, greatest at "
                    f"node {worst}, {_point(self.mesh.points[worst])}",
                    used,
                    u,
                )
            du = self._solve(data, np.where(self.fixed, 0.0, -(force + pull))) + jump
            used, since = used + 1, since + 1
            slope = float(np.sum(du * force)) if not pending else 0.0
            length, least = 1.0, np.inf
            for _ in range(12):
                found = self._residual(u + length * du, load, True)
                bad = found[3]
                slant = abs(float(np.sum(du * found[0]))) if bad < 0 else np.inf
                if slant < least:
                    least, best, (force, data, size, _) = slant, length, found
                if pending or slant <= 0.9 * abs(slope) or (least < np.inf and length < 0.05):
                    break
                length *= 0.5
            if least == np.inf:
                return f"element {bad} at {_place(self.mesh, bad)} would be inverted", used, u
            u = u + best * du
            if pending:
                jump, pending = np.zeros_like(u), False
                u[self.fixed] = goal[self.fixed]

    def _solve(self, data: np.ndarray, rhs: np.ndarray) -> np.ndarray:
        """Newton direction; a tangent that is not positive definite is shifted until it is."""
        matrix = data.copy()
        hold(matrix, self._pattern, self._diagonal, self.fixed)
        mean = float(np.trace(matrix[self._diagonal], axis1=1, axis2=2).mean()) / 3.0
        shift = 0.0
        for _ in range(12):
            try:
                self.factorisations += 1
                self._solver.factor(matrix)
                return self._solver.solve(rhs.ravel()).reshape(-1, 3)
            except NotPositive:
                more = max(10.0 * shift, 1e-4 * mean) - shift
                matrix[self._diagonal] += more * np.eye(3)
                shift += more
        raise ConvergenceError("the tangent is not positive definite; is the body held against rigid motion?")

    def save(self, path: Path) -> None:
        """Write what `resume` needs."""
        found = {"load": np.array(self.load), "displacement": self.displacement}
        for k, contact in enumerate(self.contacts):
            found |= {f"contact{k}.{name}": value for name, value in contact.state().items()}
        np.savez(path, allow_pickle=False, **found)

    def resume(self, path: Path) -> None:
        """Go on from a saved state of the same model.

        ValueError: the file is of another mesh.
        """
        with np.load(path) as found:
            if found["displacement"].shape != self.displacement.shape:
                raise ValueError(f"{path}: holds {len(found['displacement'])} nodes, the mesh has {len(self.fixed)}")
            self.load, self.displacement = float(found["load"]), found["displacement"]
            for k, contact in enumerate(self.contacts):
                head = f"contact{k}."
                contact.restore({n[len(head) :]: found[n] for n in found.files if n.startswith(head)})


def hold(data: np.ndarray, pattern: Pattern, diagonal: np.ndarray, fixed: np.ndarray) -> None:
    """Take the fixed rows and columns out of the blocks; their diagonal keeps its size."""
    row = np.repeat(np.arange(len(pattern.indptr) - 1), np.diff(pattern.indptr))
    kept = np.einsum("nii->ni", data[diagonal]).copy()
    kept[kept <= 0.0] = 1.0
    free = ~fixed
    touched = np.flatnonzero(fixed[row].any(axis=1) | fixed[pattern.indices].any(axis=1))
    data[touched] *= free[row[touched], :, None] & free[pattern.indices[touched], None, :]
    node, axis = np.nonzero(fixed)
    data[diagonal[node], axis, axis] = kept[node, axis]


def _widen(cliques: np.ndarray, width: int) -> np.ndarray:
    return np.pad(cliques, ((0, 0), (0, width - cliques.shape[1])), constant_values=-1)


def _point(at: np.ndarray) -> str:
    return f"({at[0]:.4g}, {at[1]:.4g}, {at[2]:.4g}) m"


def _place(mesh: TetMesh, element: int) -> str:
    return _point(mesh.points[mesh.elements[element, :4]].mean(axis=0))
