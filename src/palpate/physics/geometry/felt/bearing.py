"""The part of a surface that bears the load of a finger, as areas and normals of vertices.

A ball touches some triangles t of a body, with the areas A_t, middles x_t and normals n_t. The vertices j that carry
loads are those of the body or of a coarser mesh of it (`thinned`), whose hat functions are b_j. Then

    A_j = sum_t A_t b_j(x_t),    n_j ~ sum_t A_t b_j(x_t) n_t

with b_j at the nearest point of the coarser mesh. These areas sum to that of the triangles, and integrate linear
functions exactly, except for triangles at a rim between vertices of both sides: those of the untouched side bear
nothing, and b_j is over the sum of the others. At a rim areas and normals are those of the side that the ball touches.
The nodal area and normal of the mesh are those of the wall as well, by which a vertex there leant out of the touched
side: it bore less, and its beam too much.
"""

from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.nearest import nearest, tree_of


class Bearing(NamedTuple):
    """areas [m²] (V) that bear load, 0: the finger does not reach the vertex; normals [1] (V,3) of these areas, or
    of the mesh where the area is 0."""

    areas: np.ndarray
    normals: np.ndarray

    def sections(self, mesh: Mesh) -> np.ndarray:
        """Areas [m²] (V) of tissue below the vertices: below one that the finger does not reach, which bears loads of
        other senders, the nodal area."""
        return np.where(self.areas > 0.0, self.areas, mesh.areas)


def bearing_part(mesh: Mesh, whole: Mesh, touchable: np.ndarray) -> Bearing:
    """The part of the vertices of a mesh that the triangles of the whole surface represent which a ball touches.

    mesh       the whole surface, or a coarser mesh of it
    touchable  (T,) whether the ball touches each triangle of the whole surface
    """
    corners, vectors = whole.triangles[touchable], whole.face_vectors[touchable]
    share = np.full(corners.shape, 1.0 / 3.0)
    if mesh is not whole:
        touched = np.zeros(len(whole.vertices), bool)
        touched[corners] = True
        reached = touched[nearest(tree_of(whole.vertices), mesh.vertices)[1][:, 0]]
        corners, share = _hats(mesh, reached, whole.vertices[corners].mean(axis=1))
    half, count = 0.5 * vectors, len(mesh.vertices)
    size = np.sqrt(np.sum(np.square(half), axis=1))
    areas = np.bincount(corners.ravel(), (share * size[:, None]).ravel(), minlength=count)
    total = np.stack(
        [np.bincount(corners.ravel(), (share * along[:, None]).ravel(), minlength=count) for along in half.T], axis=1
    )
    length = np.sqrt(np.sum(np.square(total), axis=1))[:, None]
    return Bearing(areas, np.where(length > 0.0, total / np.where(length > 0.0, length, 1.0), mesh.normals))


def _hats(mesh: Mesh, reached: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners (n,3) of the triangle of a mesh that is nearest to each point [m] (n,3), and the barycentric
    coordinates [1] (n,3) of the nearest point on it, over their sum at the vertices that are reached (V); if none
    of its corners is, the nearest vertex that is reached."""
    feet, _, triangle, _ = MeshClosestPoint(mesh).find_sorted(points)
    corners, vectors = mesh.triangles[triangle], mesh.face_vectors[triangle]
    a, b, c = (mesh.vertices[corners[:, k]] - feet for k in range(3))
    opposite = [einsum("ij,ij->i", np.cross(p, q), vectors) for p, q in ((b, c), (c, a), (a, b))]
    parts = np.where(reached[corners], np.maximum(np.stack(opposite, axis=1), 0.0), 0.0)
    total = parts.sum(axis=1)
    lost, some = np.flatnonzero(~(total > 0.0)), np.flatnonzero(reached)
    if len(lost) and len(some):
        corners[lost] = some[nearest(tree_of(mesh.vertices[some]), points[lost])[1]]
        parts[lost, 0] = total[lost] = 1.0
    return corners, parts / np.maximum(total, 1e-300)[:, None]
