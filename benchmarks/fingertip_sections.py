"""Isostrain surfaces of a pressed finger, its section x = 0, and the flow of the isostrain surfaces with the force.

`fingertip_flow.py` draws them.
"""

from dataclasses import dataclass

import numpy as np

from palpate.models.fe.element.elements import EDGES
from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.meshing.fingertip import PLATE
from palpate.models.fe.study.isostrain import strain
from palpate.physics.contact.tactile import tactile_flow

_PARTS = np.array(
    [[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3], [4, 5, 6, 7], [4, 8, 5, 7], [5, 8, 9, 7], [5, 9, 6, 7]]
)
"""Eight tetrahedra on the ten nodes of a quadratic one."""
_SPLIT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])  # Four triangles on the six nodes of a face


def smooth(mesh: TetMesh, values: np.ndarray) -> np.ndarray:
    """Values at corners (E,4), averaged over the elements of the same layer at each node, for pictures and gradients:
    the strain is discontinuous between elements."""
    corners = mesh.elements[:, :4]
    key = corners + len(mesh.points) * mesh.region[:, None]
    _, spot = np.unique(key, return_inverse=True)
    spot = spot.ravel()
    return (np.bincount(spot, values.ravel()) / np.bincount(spot))[spot].reshape(values.shape)


def parts(points: np.ndarray, elements: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic elements (E,10) with values at their corners (E,4,...), as eight flat tetrahedra each: their corners
    [m] (8E,4,3), and linearly interpolated values (8E,4,...)."""
    middle = np.stack([0.5 * (values[:, i] + values[:, j]) for i, j in EDGES], axis=1)
    every = np.concatenate([values, middle], axis=1)
    return points[elements][:, _PARTS].reshape(-1, 4, 3), every[:, _PARTS].reshape(-1, 4, *values.shape[2:])


_RINGS = {
    3: ((1, ((0, 1), (0, 2))), (2, ((0, 2), (1, 2)))),
    4: ((1, ((0, 1), (0, 2), (0, 3))), (2, ((0, 2), (0, 3), (1, 3), (1, 2))), (3, ((0, 3), (1, 3), (2, 3)))),
}
"""Edges that a level crosses, in cyclic order, by the number of corners above it; these corners are sorted first."""


def cross(level: np.ndarray, *carried: np.ndarray) -> list[np.ndarray]:
    """The zero set of `level` (marching tetrahedra): values of `carried` at the corners of triangles (M,3,...) in
    tetrahedra, or at the ends of lines (M,2,...) in triangles.

    level    (T,4) or (T,3) at corners, linear between them
    carried  (T,4,...) or (T,3,...) such as positions, also linear
    """
    corners = level.shape[1]
    above = level > 0.0
    order = np.argsort(~above, axis=1, kind="stable")
    many = above.sum(axis=1)
    polygons: list[list[np.ndarray]] = [[] for _ in carried]
    for count, edges in _RINGS[corners]:
        cut = np.flatnonzero(many == count)
        local = order[cut]
        here = np.take_along_axis(level[cut], local, axis=1)
        for k, values in enumerate(carried):
            extra = (1,) * (values.ndim - 2)
            turned = np.take_along_axis(values[cut], local.reshape(*local.shape, *extra), axis=1)
            ring = []
            for i, j in edges:
                part = (here[:, i] / (here[:, i] - here[:, j])).reshape(-1, *extra)
                ring.append(turned[:, i] + part * (turned[:, j] - turned[:, i]))
            if corners == 3:
                polygons[k].append(np.stack(ring, axis=1))
            else:
                polygons[k] += [np.stack([ring[0], ring[m], ring[m + 1]], axis=1) for m in range(1, len(ring) - 1)]
    return [np.concatenate(x) for x in polygons]


@dataclass(frozen=True)
class Section:
    """Section of a pressed finger: the material plane x = 0, deformed, in (y, z) [m]."""

    triangles: np.ndarray  # (M,3,2) of the finger
    values: np.ndarray  # (M,3,...) there
    borders: np.ndarray  # (B,2,2) lines between layers and round the finger
    plate: np.ndarray  # (P,2,2) outline of a deformable plate


def section(mesh: TetMesh, displacement: np.ndarray, values: np.ndarray) -> Section:
    """Cut a pressed finger where x = 0 in the undeformed state.

    mesh          plate included
    displacement  [m] (N,3)
    values        (E,4,...) at the corners of the finger's elements, in the order of the mesh
    """
    moved = mesh.points + displacement
    shift = 1e-6 * mesh.size  # distance from the plane of symmetry, which contains faces of the mesh
    inside = mesh.region != PLATE
    flat, carried = parts(moved, mesh.elements[inside], values)
    before, _ = parts(mesh.points, mesh.elements[inside], np.zeros((inside.sum(), 4)))
    near = np.abs(before[:, :, 0] - shift).min(axis=1) < 0.2 * mesh.size
    triangles, corner_values = cross((before[:, :, 0] - shift)[near], flat[near][:, :, 1:], carried[near])
    lines = [_outline(mesh, moved, np.flatnonzero(mesh.region == k), shift) for k in np.unique(mesh.region[inside])]
    plate = np.zeros((0, 2, 2)) if inside.all() else _outline(mesh, moved, np.flatnonzero(~inside), shift)
    return Section(triangles, corner_values, np.concatenate(lines), plate)


def _outline(mesh: TetMesh, moved: np.ndarray, elements: np.ndarray, shift: float) -> np.ndarray:
    faces = mesh.boundary(elements)[:, _SPLIT].reshape(-1, 3)
    (segments,) = cross(mesh.points[faces][:, :, 0] - shift, moved[faces][:, :, 1:])
    return segments


def finger(mesh: TetMesh) -> TetMesh:
    """The mesh without the plate."""
    inside = mesh.region != PLATE
    return TetMesh(mesh.points, mesh.elements[inside], mesh.region[inside])


def flow(
    mesh: TetMesh, low: np.ndarray, high: np.ndarray, force_low: float, force_high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean strain [1] (E,4) of two states of a finger, and the flow of its isostrain surfaces between them [m/N]
    (E,4,3), relative to the tissue, in the middle configuration; both averaged at nodes within the layers.

    mesh       mesh without the plate
    low, high  [m] (N,3) displacements at the two forces [N]
    """
    first, second = (smooth(mesh, strain(mesh, u)) for u in (low, high))
    middle = (mesh.points + 0.5 * (low + high))[mesh.elements[:, :4]]
    flows = tactile_flow(middle, first, second, force_low, force_high)
    every = np.repeat(flows[:, None, :], 4, axis=1)
    return 0.5 * (first + second), np.stack([smooth(mesh, every[:, :, k]) for k in range(3)], axis=2)
