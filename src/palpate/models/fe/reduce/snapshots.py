"""Full solutions of a body under increasing patch loads: snapshots for its modes, and reference for its errors."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import qmc

from palpate.compiler.trust import may_read
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.reduce.reducible import Reducible
from palpate.models.fe.solve.solver import ConvergenceError, Settings
from palpate.physics.archive import replacing
from palpate.physics.geometry.mesh import Mesh

STIFFENING = np.array([0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
"""Shares of the largest load at which a solution is stored, for a body that stiffens by a factor of 100."""
MILD = np.array([0.25, 0.5, 0.75, 1.0])  # The same for other bodies
TOLERANCE, MOST, MEMORY = 3e-4, 40, 8
"""`press_from_rest`: relative step at convergence, most iterations, iterates in Anderson's method."""
YOUNG = 1e3  # [Pa] Modulus of the full model; displacements do not depend on it
STEPS = Settings(tolerance=1e-4, step=1.0, largest=1.0, least=0.1, iterations=12)  # in levels, see `press_touch`
TURN = np.array([-1.0, 1.0, 1.0])  # Reflection in x


@dataclass(frozen=True)
class LoadPath:
    """An increasing load on the surface.

    foot    [m] (3)  centre
    normal  [1] (3)  out of the body
    """

    foot: np.ndarray
    normal: np.ndarray
    load: np.ndarray  # [1] (V,3) unit force along the inner normal, with its tangential part
    levels: np.ndarray  # [N] (L,) increasing forces, for a modulus of 1 Pa

    def mirror(self, vertices: np.ndarray) -> LoadPath:
        """Reflected in x; vertices (V,) is the index of the vertex at the reflected position of each vertex."""
        return LoadPath(TURN * self.foot, TURN * self.normal, TURN * self.load[vertices], self.levels)


@dataclass
class PressSolution:
    """A touch and the full solutions (L',N,3) [m] at its first L' levels, up to the last that converged."""

    touch: LoadPath
    solutions: np.ndarray


def patch(surface: Mesh, foot: np.ndarray, normal: np.ndarray, radius: float) -> np.ndarray:
    """Unit force (V,3) on the vertices of a surface: pressure (1 - d²/R²)² around a foot point, against its normal.
    ValueError: no part of the surface within the radius faces the normal."""
    corner, face, hat = surface.vertices[surface.triangles], surface.face_vectors, face_rule.HATS
    away = np.linalg.norm(np.einsum("qc,fci->fqi", hat, corner) - foot, axis=2) / radius
    weight = np.where(away < 1.0, (1.0 - away * away) ** 2, 0.0) * face_rule.WEIGHTS
    weight *= (np.linalg.norm(face, axis=1) * (face @ normal > 0.0))[:, None]
    share = np.zeros(len(surface.vertices))
    np.add.at(share, surface.triangles, np.einsum("fq,qc->fc", weight, hat))
    if not share.sum() > 0.0:
        raise ValueError(f"no surface within {radius} m of {foot}")
    return -np.outer(share / share.sum(), normal)


def touch(
    surface: Mesh, foot: np.ndarray, normal: np.ndarray, radius: float, levels: np.ndarray, pull: np.ndarray
) -> LoadPath:
    """A patch load around a foot point, with the tangential force `pull` [1] (3) per unit of normal force."""
    share = -patch(surface, foot, normal, radius) @ normal
    return LoadPath(foot, normal, np.outer(share, pull - normal), levels)


def aside(normal: np.ndarray, along: np.ndarray, turn: float) -> np.ndarray:
    """Unit tangent (3): normal × along, rotated by `turn` revolutions about the normal."""
    across = np.cross(normal, along)
    across /= np.linalg.norm(across)
    return np.cos(2.0 * np.pi * turn) * across + np.sin(2.0 * np.pi * turn) * np.cross(normal, across)


def scatter(
    surface: Mesh, count: int, region: np.ndarray, radius: float, levels: np.ndarray, seed: int
) -> list[LoadPath]:
    """Normal touches distributed evenly over a part of the surface (Halton sequence, scrambled by `seed`).

    region  (T,) bool, triangles that may be touched
    radius  [m]  of the patches
    levels  [N]  (L,) forces, for a modulus of 1 Pa
    """
    corner = surface.vertices[surface.triangles]
    area = np.linalg.norm(surface.face_vectors, axis=1) * region
    share = np.cumsum(area) / area.sum()
    touches = []
    for x in qmc.Halton(3, seed=seed).random(count):
        t = int(np.searchsorted(share, x[0]))
        a, b = np.sqrt(x[1]), x[2]
        weight = np.array([1.0 - a, a * (1.0 - b), a * b])
        foot, normal = weight @ corner[t], weight @ surface.normals[surface.triangles[t]]
        touches.append(touch(surface, foot, normal / np.linalg.norm(normal), radius, levels, np.zeros(3)))
    return touches


def press_touches(
    body: Reducible, touches: list[LoadPath], report: Report = unheard, folder: Path | None = None
) -> list[PressSolution]:
    """Solutions of the full model. Each is stored in the folder, if any, and read from it when it exists."""
    return _all(body, touches, report, folder, repr(STEPS), lambda path: press_touch(body, path))


def _all(
    body: Reducible, touches: list[LoadPath], report: Report, folder: Path | None, method: str,
    solve: Callable[[LoadPath], list[np.ndarray]],
) -> list[PressSolution]:  # fmt: skip
    """The solutions of touches, from the folder where they exist there; the file name is a hash of all inputs."""
    presses = []
    for k, path in enumerate(touches):
        file, solutions = None, None
        if folder is not None:
            loads = b"".join(np.ascontiguousarray(part).tobytes() for part in (path.load, path.levels))
            file = folder / f"{hashlib.sha256(body.digest + method.encode() + loads).hexdigest()[:24]}.npy"
            with suppress(OSError, ValueError, EOFError):  # damaged
                solutions = np.load(file, allow_pickle=False) if may_read(file) else None
        if solutions is None:
            solutions = np.array(solve(path)).reshape(-1, *body.mesh.points.shape)
            if file is not None:
                with replacing(file, cached=True) as part:
                    np.save(part, solutions)
        presses.append(PressSolution(path, solutions))
        report((k + 1) / len(touches))
    return presses


def press_touch(body: Reducible, touch: LoadPath) -> list[np.ndarray]:
    """Solutions of the full model for one touch.

    Load steps are in numbers of levels, with geometric interpolation between levels: the displacement of a stiffening
    body grows roughly with the logarithm of the load, so that linear extrapolation gives a good initial guess.
    """
    load, number = body.hats @ touch.load, np.arange(1.0, len(touch.levels) + 1.0)

    def loads(step: float) -> np.ndarray:
        size = np.exp(np.interp(step, number, np.log(touch.levels))) if step > 1.0 else step * touch.levels[0]
        return YOUNG * float(size) * load

    solver, kept = body.solver(YOUNG, loads, STEPS), []
    for level in number:
        try:
            solver.advance(float(level))
        except ConvergenceError:
            break
        kept.append(solver.displacement.copy())
    return kept


def press_from_rest(
    body: Reducible, touches: list[LoadPath], report: Report = unheard, folder: Path | None = None
) -> list[PressSolution]:
    """`press_touches` for a body whose stiffness is near that at rest: modified Newton u <- u + K0^-1 (f - r(u)) with
    a single factorization and Anderson acceleration. A touch ends at the last level that converges."""
    solver = body.elastic.rest(body.fixed)

    def solve(force: np.ndarray) -> np.ndarray:
        displacement = solver.solve(np.where(body.fixed, 0.0, force).ravel()[:, None]).reshape(-1, 3)
        displacement[body.fixed] = 0.0
        return displacement

    def solution(touch: LoadPath) -> list[np.ndarray]:
        load = body.hats @ touch.load
        slope = solve(load)
        last, u, kept = 0.0, np.zeros_like(load), []
        for level in touch.levels:
            start = u
            after = _equilibrium(body, solve, level * load, u + (level - last) * slope)
            if after is None:
                break
            u = after
            slope, last = (u - start) / (level - last), level
            kept.append(u)
        return kept

    return _all(body, touches, report, folder, repr((TOLERANCE, MOST, MEMORY)), solution)


def _equilibrium(
    body: Reducible, solve: Callable[[np.ndarray], np.ndarray], load: np.ndarray, u: np.ndarray
) -> np.ndarray | None:
    """Equilibrium near u by modified Newton with Anderson acceleration; None if the iteration does not converge."""
    steps: list[np.ndarray] = []
    points: list[np.ndarray] = []
    for _ in range(MOST):
        force = body.elastic.forces(u)
        if force is None:
            return None
        step = solve(load - force)
        work = abs(float(np.sum(load * step)))
        if work < TOLERANCE * abs(float(np.sum(load * u))) and np.linalg.norm(step) < 3 * TOLERANCE * np.linalg.norm(u):
            return u + step
        steps.append(step)
        points.append(u)
        del steps[: -MEMORY - 1], points[: -MEMORY - 1]
        u = u + step
        if len(steps) > 1:
            # Anderson: combine the last iterates to minimize the step in least squares
            residuals, moves = np.diff(steps, axis=0), np.diff(points, axis=0)
            share = np.linalg.lstsq(residuals.reshape(len(residuals), -1).T, step.ravel(), rcond=1e-10)[0]
            u = u - np.tensordot(share, residuals + moves, axes=1)
    return None


def mirror_solutions(pressed: list[PressSolution], nodes: np.ndarray, vertices: np.ndarray) -> list[PressSolution]:
    """Solutions of the touches reflected in x; nodes (N,) and vertices (V,) are indices at the reflected positions."""
    return [PressSolution(p.touch.mirror(vertices), TURN * p.solutions[:, nodes]) for p in pressed]


def mirror(points: np.ndarray) -> np.ndarray:
    """Index (N,) of the point at the position of each point reflected in x. ValueError: not symmetric."""
    size = 1e-6 * float(np.ptp(points, axis=0).max())
    away, index = cKDTree(points).query(points * TURN)
    if (away > size).any():
        raise ValueError("the points are not symmetric in x")
    return index
