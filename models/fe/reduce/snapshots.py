"""Full solutions of a body under growing patch loads: what its modes are made from and measured against."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import qmc

from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.reduce.reducible import Reducible
from palpate.models.fe.solve.solver import ConvergenceError, Settings
from palpate.physics.archive import replacing
from palpate.physics.geometry.mesh import Mesh

STIFFENING = np.array([0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
"""Shares of the greatest load at which a solution is kept, for a body that stiffens a hundredfold."""
MILD = np.array([0.25, 0.5, 0.75, 1.0])  # The same for a body that does not
TOLERANCE, MOST, MEMORY = 3e-4, 40, 8
"""Step of the iteration from rest, over the displacement, at which it has settled; its length; iterates mixed."""
YOUNG = 1e3  # [Pa] Modulus that the full model is solved with; displacements do not depend on it
STEPS = Settings(tolerance=1e-4, step=1.0, largest=1.0, least=0.1, iterations=12)  # Steps count levels, see `press`
TURN = np.array([-1.0, 1.0, 1.0])  # Mirrors a place or a vector in x


@dataclass(frozen=True)
class LoadPath:
    """A growing load on the surface.

    foot, normal [m], [1] (3)   where, and out of the body
    """

    foot: np.ndarray
    normal: np.ndarray
    load: np.ndarray  # [1] (V,3) unit force along the inner normal, with its tangential part
    levels: np.ndarray  # [N] (L,) forces at which the solution is wanted, rising

    def mirrored(self, vertices: np.ndarray) -> LoadPath:
        """The same in x, where (V,) is the vertex at each one's mirrored place."""
        return LoadPath(TURN * self.foot, TURN * self.normal, TURN * self.load[vertices], self.levels)


@dataclass
class PressSolution:
    """A touch and the full solutions (L',N,3) [m] at its first L' levels, as far as the body held."""

    touch: LoadPath
    solutions: np.ndarray


def patch(surface: Mesh, foot: np.ndarray, normal: np.ndarray, radius: float) -> np.ndarray:
    """Unit force (V,3) on the vertices of a surface: pressure (1 - d²/R²)² round a foot point, against its normal.
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
    """A patch load round a foot point, with this tangential force [1] (3) for each unit of the normal one."""
    share = -patch(surface, foot, normal, radius) @ normal
    return LoadPath(foot, normal, np.outer(share, pull - normal), levels)


def aside(normal: np.ndarray, along: np.ndarray, turn: float) -> np.ndarray:
    """Unit vector (3) square to the normal, `turn` revolutions round it from where it is square to `along`, too."""
    across = np.cross(normal, along)
    across /= np.linalg.norm(across)
    return np.cos(2.0 * np.pi * turn) * across + np.sin(2.0 * np.pi * turn) * np.cross(normal, across)


def scatter(
    surface: Mesh, count: int, region: np.ndarray, radius: float, levels: np.ndarray, seed: int
) -> list[LoadPath]:
    """Normal touches spread evenly over a part of the surface (Halton's sequence, scrambled by `seed`).

    region  (T,) bool, triangles that may be touched
    radius  [m]  of the patches
    levels  [N]  (L,) forces
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


def press(
    body: Reducible, touches: list[LoadPath], report: Report = unheard, folder: Path | None = None
) -> list[PressSolution]:
    """The full model's answers. A folder keeps each as soon as it is found: what it holds is not computed again."""
    presses = []
    for k, own in enumerate(touches):
        presses.append(_kept(body, own, folder, repr(STEPS), lambda own: pressed(body, own)))
        report((k + 1) / len(touches))
    return presses


def _kept(
    body: Reducible, own: LoadPath, folder: Path | None, how: str, solve: Callable[[LoadPath], PressSolution]
) -> PressSolution:
    """The solution of a touch, or what the folder holds of it: its file is named by all that it follows from."""
    if folder is None:
        return solve(own)
    name = hashlib.sha256(body.digest + how.encode())
    for part in (own.load, own.levels):
        name.update(np.ascontiguousarray(part).tobytes())
    path = folder / f"{name.hexdigest()[:24]}.npy"
    with suppress(OSError, ValueError, EOFError):  # none yet, or one that was damaged
        return PressSolution(own, np.load(path))
    answer = solve(own)
    with replacing(path) as file:
        np.save(file, answer.solutions)
    return answer


def pressed(body: Reducible, own: LoadPath) -> PressSolution:
    """The full model's answer to one touch.

    The load is stepped by the number of its level, geometrically between levels: the displacement of a body that
    stiffens grows about as the logarithm of the load, so that a step that is carried on straight from the last one
    starts near its end.
    """
    load, number = body.hats @ own.load, np.arange(1.0, len(own.levels) + 1.0)

    def loads(step: float) -> np.ndarray:
        size = np.exp(np.interp(step, number, np.log(own.levels))) if step > 1.0 else step * own.levels[0]
        return YOUNG * float(size) * load

    solver, kept = body.solver(YOUNG, loads, STEPS), []
    for level in number:
        try:
            solver.advance(float(level))
        except ConvergenceError:
            break
        kept.append(solver.displacement.copy())
    return PressSolution(own, np.array(kept).reshape(-1, *body.mesh.points.shape))


def press_from_rest(
    body: Reducible, touches: list[LoadPath], report: Report = unheard, folder: Path | None = None
) -> list[PressSolution]:
    """`press` for a body that stays near its stiffness at rest: one factor, u <- u + K0^-1 (f - r(u)), earlier iterates
    mixed in (Anderson, as in `fe.curves`). A touch ends where the iteration does not settle."""
    solver = body.elastic.rest(body.fixed)

    def solve(force: np.ndarray) -> np.ndarray:
        displacement = solver.solve(np.where(body.fixed, 0.0, force).ravel()[:, None]).reshape(-1, 3)
        displacement[body.fixed] = 0.0
        return displacement

    def answer(own: LoadPath) -> PressSolution:
        load = body.hats @ own.load
        slope = solve(load)
        last, u, kept = 0.0, np.zeros_like(load), []
        for level in own.levels:
            start = u
            after = _settled(body, solve, level * load, u + (level - last) * slope)
            if after is None:
                break
            u = after
            slope, last = (u - start) / (level - last), level
            kept.append(u)
        return PressSolution(own, np.array(kept).reshape(-1, *body.mesh.points.shape))

    presses = []
    for k, own in enumerate(touches):
        presses.append(_kept(body, own, folder, repr((TOLERANCE, MOST, MEMORY)), answer))
        report((k + 1) / len(touches))
    return presses


def _settled(
    body: Reducible, solve: Callable[[np.ndarray], np.ndarray], load: np.ndarray, u: np.ndarray
) -> np.ndarray | None:
    """Equilibrium near u; None where there is none to be found."""
    steps: list[np.ndarray] = []
    points: list[np.ndarray] = []
    for _ in range(MOST):
        force = body.elastic.forces(u)
        if force is None:
            return None
        step = solve(load - force)
        miss = abs(float(np.sum(load * step)))
        if miss < TOLERANCE * abs(float(np.sum(load * u))) and np.linalg.norm(step) < 3 * TOLERANCE * np.linalg.norm(u):
            return u + step
        steps.append(step)
        points.append(u)
        del steps[: -MEMORY - 1], points[: -MEMORY - 1]
        u = u + step
        if len(steps) > 1:
            turned, moved = np.diff(steps, axis=0), np.diff(points, axis=0)
            many = len(turned)
            share = np.linalg.lstsq(turned.reshape(many, -1).T, step.ravel(), rcond=1e-10)[0]
            u = u - np.tensordot(share, turned + moved, axes=1)
    return None


def mirrored(pressed: list[PressSolution], nodes: np.ndarray, vertices: np.ndarray) -> list[PressSolution]:
    """What the full model answers to the touches mirrored in x; nodes (N,), vertices (V,) those at mirrored places."""
    return [PressSolution(p.touch.mirrored(vertices), TURN * p.solutions[:, nodes]) for p in pressed]


def mirror(points: np.ndarray) -> np.ndarray:
    """Index (N,) of the point at each one's place mirrored in x. ValueError: a point without one."""
    size = 1e-6 * float(np.ptp(points, axis=0).max())
    away, index = cKDTree(points).query(points * TURN)
    if (away > size).any():
        raise ValueError("the points are not symmetric in x")
    return index
