"""Equivalent strain in a deformed finger, and the surfaces on which it has one value.

In each element the strain is linear between its corners, so that a surface crosses it in one flat polygon and the
volume above is cut off exactly (`physics.tactile.isostrain_volume`).
"""

from __future__ import annotations

import numpy as np

from palpate.fe.elements import gradients
from palpate.fe.layers import BONE, EPIDERMIS, NAIL
from palpate.fe.mesh import TetMesh
from palpate.physics.tactile import equivalent_strain, logarithmic_strain

_CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_PARTS = np.array(
    [[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3], [4, 5, 6, 7], [4, 8, 5, 7], [5, 8, 9, 7], [5, 9, 6, 7]]
)
"""Eight tetrahedra on the ten nodes of a quadratic one."""


def strain(mesh: TetMesh, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equivalent strain at the corners of each element [1] (E,4), of that element alone, and deformed volumes [m³]
    (E,).

    Effective Poisson ratio: the material's in the elastic layers, 0.5 in the others.

    displacement  [m] (N,3)
    """
    slope, _ = gradients(mesh.points, mesh.elements, _CORNERS)
    gradient = np.eye(3) + np.einsum("eai,enaj->enij", displacement[mesh.elements], slope)
    elastic = np.isin(mesh.region, (BONE, EPIDERMIS, NAIL))
    found = equivalent_strain(logarithmic_strain(gradient), np.where(elastic, 0.3, 0.5)[:, None])
    a, b, c, d = ((mesh.points + displacement)[mesh.elements[:, i]] for i in range(4))
    return found, np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def smooth(mesh: TetMesh, values: np.ndarray) -> np.ndarray:
    """Values at corners (E,4), each the mean over the elements of the same layer that meet there: for pictures and
    slopes, as the strain of one element jumps to the next."""
    corners = mesh.elements[:, :4]
    key = corners + len(mesh.points) * mesh.region[:, None]
    _, spot = np.unique(key, return_inverse=True)
    spot = spot.ravel()
    return (np.bincount(spot, values.ravel()) / np.bincount(spot))[spot].reshape(values.shape)


def parts(points: np.ndarray, elements: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic elements (E,10) with values at their corners (E,4,...) as eight flat tetrahedra each: the corners of
    these [m] (8E,4,3), and the values there (8E,4,...), linear in each element."""
    ends = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
    middle = np.stack([0.5 * (values[:, i] + values[:, j]) for i, j in ends], axis=1)
    every = np.concatenate([values, middle], axis=1)
    return points[elements][:, _PARTS].reshape(-1, 4, 3), every[:, _PARTS].reshape(-1, 4, *values.shape[2:])


_RINGS = {
    3: ((1, ((0, 1), (0, 2))), (2, ((0, 2), (1, 2)))),
    4: ((1, ((0, 1), (0, 2), (0, 3))), (2, ((0, 2), (0, 3), (1, 3), (1, 2))), (3, ((0, 3), (1, 3), (2, 3)))),
}
"""Edges that a level crosses, in turn round the piece, by the number of corners above it; those above come first."""


def cross(level: np.ndarray, *carried: np.ndarray) -> list[np.ndarray]:
    """Where `level` is zero: what is carried along, at the corners of triangles (M,3,...) that cut tetrahedra, or at
    the ends of lines (M,2,...) that cut triangles.

    level    (T,4) or (T,3) at corners, linear between them
    carried  (T,4,...) or (T,3,...) such as places or other values, linear too
    """
    corners = level.shape[1]
    above = level > 0.0
    order = np.argsort(~above, axis=1, kind="stable")
    many = above.sum(axis=1)
    found: list[list[np.ndarray]] = [[] for _ in carried]
    for count, edges in _RINGS[corners]:
        own = np.flatnonzero(many == count)
        local = order[own]
        here = np.take_along_axis(level[own], local, axis=1)
        for k, values in enumerate(carried):
            extra = (1,) * (values.ndim - 2)
            turned = np.take_along_axis(values[own], local.reshape(*local.shape, *extra), axis=1)
            ring = []
            for i, j in edges:
                part = (here[:, i] / (here[:, i] - here[:, j])).reshape(-1, *extra)
                ring.append(turned[:, i] + part * (turned[:, j] - turned[:, i]))
            if corners == 3:
                found[k].append(np.stack(ring, axis=1))
            else:
                found[k] += [np.stack([ring[0], ring[m], ring[m + 1]], axis=1) for m in range(1, len(ring) - 1)]
    return [np.concatenate(x) for x in found]
