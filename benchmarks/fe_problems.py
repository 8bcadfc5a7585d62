"""The problems that all solvers compute: a block compressed between clamps or on a plane, a ball pressed on a plane.

The material is neo-Hookean, W = (mu/2) (J^(-2/3) I1 - 3) + (kappa/2) (J - 1)²; load steps are equal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.models.fe import TetMesh, box
from palpate.models.fe.element.mesh import bricks, edge_nodes, grid

YOUNG, POISSON = 1e4, 0.3
STEPS = 4
RADIUS = 0.01
"""[m] of the ball."""
STIFF = 2e4 * YOUNG
"""[Pa] Contact penalty times the size of the body; the penetration is about 1e-5 of this size."""


@dataclass(frozen=True)
class FEProblem:
    """A body that is pressed down, with or without a rigid plane below it.

    fixed    (N,3) fixed directions of the nodes
    driven   (N,) nodes that move down by `travel` [m]
    skin     (F,6) faces that may touch the plane at the height `floor` [m] with normal (0, 0, 1); empty: no plane
    steps    number of equal load steps
    penalty  [Pa/m] of the contact
    share    [m²] area of a node of the skin, for contact at nodes
    """

    mesh: TetMesh
    fixed: np.ndarray
    driven: np.ndarray
    travel: float
    skin: np.ndarray
    floor: float = 0.0
    steps: int = STEPS
    penalty: float = STIFF
    share: float = 0.0


def block(cells: int) -> FEProblem:
    """A unit cube, both ends clamped, compressed by 30 %."""
    mesh = box((1.0, 1.0, 1.0), (cells, cells, cells))
    z = mesh.points[:, 2]
    top = z > 1 - 1e-9
    fixed = np.repeat((top | (z < 1e-9))[:, None], 3, axis=1)
    return FEProblem(mesh, fixed, top, 0.3, np.zeros((0, 6), dtype=np.int64))


def step(cells: int) -> FEProblem:
    """A unit cube, both ends clamped, compressed by 5 % in one step."""
    return replace(block(cells), travel=0.05, steps=1)


def pressed(cells: int) -> FEProblem:
    """A unit cube, clamped at its top, pressed on a plane by 30 % in ten steps, without friction."""
    body = block(cells)
    top = np.repeat(body.driven[:, None], 3, axis=1)
    skin = body.mesh.faces[(body.mesh.points[body.mesh.faces][:, :, 2] < 1e-9).all(axis=1)]
    return replace(body, fixed=top, skin=skin, steps=10, share=1.0 / len(np.unique(skin)))


def ball(cells: int) -> FEProblem:
    """A ball pressed between two planes by 10 % of its radius each, without friction; 1/8 of it by symmetry."""
    mesh = _octant(cells)
    x, y, z = mesh.points.T
    near = 1e-9 * RADIUS
    top = z > -near
    fixed = np.stack([x < near, y < near, top], axis=1)
    corner = mesh.points[mesh.faces[:, :3]]
    outer = (np.linalg.norm(corner, axis=2) > (1 - 1e-9) * RADIUS).all(axis=1)
    skin = mesh.faces[outer & (corner[:, :, 2].mean(axis=1) < -0.7 * RADIUS)]
    near_pole = np.linalg.norm(mesh.points[np.unique(skin), :2], axis=1) < 0.3 * RADIUS
    share = np.pi / 4 * (0.3 * RADIUS) ** 2 / near_pole.sum()
    return FEProblem(mesh, fixed, top, 0.1 * RADIUS, skin, -RADIUS, penalty=STIFF / RADIUS, share=share)


def _octant(cells: int) -> TetMesh:
    """The part x, y > 0 > z of a ball: a core of bricks with shells around it, finest at the pole; curved faces."""
    t = np.linspace(0.0, 1.0, cells + 1)
    fine = 0.5 * t + 0.5 * t**2
    core, hexahedra = grid(fine, fine, t)
    n = cells + 1
    node = np.arange(len(core)).reshape(n, n, n)
    quad = np.array([[0, 1, n, n + 1], [0, 1, n * n, n * n + 1], [0, n, n * n, n * n + n]])
    outer = [
        node[-1, :-1, :-1].reshape(-1, 1) + quad[0],
        node[:-1, -1, :-1].reshape(-1, 1) + quad[1],
        node[:-1, :-1, -1].reshape(-1, 1) + quad[2],
    ]
    surface, on = np.unique(np.concatenate(outer), return_inverse=True)
    on = on.reshape(-1, 4)
    points, every, below = [np.column_stack([core, np.zeros(len(core))])], [hexahedra], surface[on]
    levels = 1.0 - (1.0 - np.linspace(0.0, 1.0, cells + 1)[1:]) ** 1.5
    for k, level in enumerate(levels):
        above = len(core) + k * len(surface) + on
        points.append(np.column_stack([core[surface], np.full(len(surface), level)]))
        every.append(np.concatenate([below, above], axis=1))
        below = above
    lattice = np.concatenate(points)
    corners = bricks(_place(lattice), np.concatenate(every))
    elements, edges = edge_nodes(len(lattice), corners)
    return TetMesh(_place(np.concatenate([lattice, lattice[edges].mean(axis=1)])), elements)


def _place(lattice: np.ndarray) -> np.ndarray:
    """Points [m] (N,3) from lattice coordinates (N,4): three of the core's cube, one from 0 (core) to 1 (surface)."""
    cube, shell = lattice[:, :3], lattice[:, 3:]
    ray = np.tan(np.pi / 4 * cube)
    ray /= np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-12)
    points: np.ndarray = RADIUS * ((1.0 - shell) * 0.5 * cube + shell * ray) * (1.0, 1.0, -1.0)
    return points
