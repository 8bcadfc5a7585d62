"""Walls of an organ that are near each other, as those of a cut or of a fissure between two lobes.

Under a finger the walls of a narrow gap meet: those of a free cut through a block approach each other by 1.9 times the
indentation. A body whose walls stay free is then 0.65 to 0.71 times as stiff as an uncut one within 3 mm of the cut,
where walls that push on each other without friction give 0.81 to 1.00 (docs/equations/reduced-fe.md).
"""

from typing import NamedTuple

import numpy as np

from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.mesh import TetMesh
from palpate.physics.geometry.crossing import crossing
from palpate.physics.geometry.felt.hollow import distance_to
from palpate.physics.geometry.felt.opposite import opposite, unit
from palpate.physics.geometry.felt.touchable import divide_long_edges, untouchable
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.pieces import parents, pieces

THINNEST = 0.01  # [1] gap over the length of a face's side, at least: that of a spring, which is stiff but not rigid


class NearWalls(NamedTuple):
    """A closed surface, and which of its triangles face another part of it.

    surface  the triangles of the given one, with long edges divided
    walls    (T,) whether each triangle faces another part
    gap      [m] (T,) distance to that part, 0 for other triangles
    """

    surface: Mesh
    walls: np.ndarray
    gap: np.ndarray


class Facing(NamedTuple):
    """Pairs of points on the boundary of a mesh, see `fe.contact.walls`; area [m²] (P,), gap [m] (P,)."""

    nodes: np.ndarray
    values: np.ndarray
    normals: np.ndarray
    area: np.ndarray
    gap: np.ndarray


def near_walls(surface: Mesh, reach: float, longest: float) -> NearWalls | None:
    """The walls of a closed surface that are nearer to each other than `reach` [m]; None: no two are.

    longest  [m] edges to which the triangles are divided, as each is tested at its middle
    """
    fine, _ = divide_long_edges(surface, longest)
    closest = MeshClosestPoint(surface)
    hidden = np.flatnonzero(untouchable(fine, closest, 0.5 * reach))
    middle, normal = fine.vertices[fine.triangles[hidden]].mean(axis=1), unit(fine.face_vectors[hidden])
    _, other, gap = opposite(closest, surface, middle, normal, 0.5 * reach)
    walls = np.zeros(len(fine.triangles), bool)
    walls[hidden[other >= 0]] = True
    distance = np.zeros(len(walls))
    distance[hidden] = np.where(other >= 0, gap, 0.0)
    return NearWalls(fine, walls, distance) if walls.any() else None


def bodies(surface: Mesh) -> list[Mesh]:
    """The separate bodies of a closed surface: each outer piece with its cavities. One if pieces cross."""
    vertices, triangles = surface.vertices, surface.triangles
    label = pieces(triangles, len(vertices))
    if not label.any() or crossing(vertices, triangles) is not None:
        return [surface]
    outer = parents(vertices, triangles, label)
    body = np.arange(len(outer))
    while (inner := outer[body] >= 0).any():
        body[inner] = outer[body[inner]]
    found = []
    for one in np.unique(body):
        used, corners = np.unique(triangles[body[label] == one], return_inverse=True)
        found.append(Mesh(vertices[used], np.ascontiguousarray(corners.reshape(-1, 3), np.int32)))
    return found


def facing(mesh: TetMesh, near: NearWalls, reach: float, tolerance: float) -> Facing:
    """The pairs of points of a mesh that face each other across the walls of its surface, at most `reach` [m] apart.

    tolerance  [m] largest distance of the boundary of the mesh from the surface
    """
    faces = mesh.faces
    boundary = Mesh(mesh.points, np.ascontiguousarray(faces[:, :3], np.int32))
    walls = MeshClosestPoint(Mesh(near.surface.vertices, near.surface.triangles[near.walls]))
    points = np.einsum("qa,fai->fqi", face_rule.VALUES, mesh.points[faces])
    at = np.argwhere(distance_to(walls, points.reshape(-1, 3)).reshape(points.shape[:2]) <= tolerance)
    face, point = at.T
    normal = unit(boundary.face_vectors)
    radius = 0.5 * reach + tolerance
    place = points[face, point]
    feet, other, gap = opposite(MeshClosestPoint(boundary), boundary, place, normal[face], radius, 2.0 * tolerance)
    seen = (other >= 0) & (other != face)
    face, point, feet, other, gap = face[seen], point[seen], feet[seen], other[seen], gap[seen]
    sides = np.linalg.norm(np.diff(mesh.points[faces[face][:, [0, 1, 2, 0]]], axis=1), axis=2).mean(axis=1)
    values = np.concatenate([face_rule.VALUES[point], -face_rule.shape(_weights(boundary, other, feet))[0]], axis=1)
    return Facing(
        np.concatenate([faces[face], faces[other]], axis=1), values, unit(normal[face] - normal[other]),
        0.5 * face_rule.areas(mesh.points, faces)[face, point],  # both walls have their points
        np.maximum(gap, THINNEST * sides),
    )  # fmt: skip


def _weights(surface: Mesh, triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Natural coordinates (n,2) of points [m] (n,3) on triangles (n)."""
    a, b, c = (surface.vertices[surface.triangles[triangles, i]] for i in range(3))
    normal = surface.face_vectors[triangles]
    square = np.einsum("ni,ni->n", normal, normal)
    x = np.einsum("ni,ni->n", np.cross(points - a, c - a), normal) / square
    y = np.einsum("ni,ni->n", np.cross(b - a, points - a), normal) / square
    return np.stack([x, y], axis=1)
