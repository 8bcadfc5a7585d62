"""Section of a pressed finger: the material plane x = 0, deformed, for pictures."""

from dataclasses import dataclass

import numpy as np

from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.meshing.layers import PLATE
from palpate.models.fe.study.isostrain import cross, parts, smooth, strain
from palpate.physics.contact.tactile import tactile_flow

_SPLIT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])  # Four triangles on the six nodes of a face


@dataclass(frozen=True)
class Section:
    """A section, in the plane (y, z) [m]."""

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
