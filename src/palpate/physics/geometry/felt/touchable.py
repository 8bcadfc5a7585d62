"""Which triangles of a surface a ball can touch.

A ball of radius r touches the surface at x, with the outward normal n, if no other part of the body is within r of its
centre x + r n. The test at the middle of a triangle is enough where edges are short; larger triangles are divided.
"""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edges import edges_of

SLACK = 20e-6
"""[m] By which another part may be inside the ball: facets of 1.6 mm on a concave surface just wider than the ball are
16 um nearer than the surface that they approximate."""
SHORT = 1 / 3  # [1] of the radius: longest edge of a triangle whose middle represents it


def divide_long_edges(mesh: Mesh, longest: float) -> tuple[Mesh, np.ndarray]:
    """The same flat triangles with edges of at most `longest` [m], and for each the triangle of `mesh` (T,)."""
    points, triangles, origin = mesh.vertices, mesh.triangles.astype(np.int64), np.arange(len(mesh.triangles))
    while True:
        ends, of, _ = edges_of(triangles, len(points))
        long = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1) > longest
        if not long.any():
            return Mesh(points, np.ascontiguousarray(triangles, np.int32)), origin
        number = np.full(len(ends), -1)
        number[long] = len(points) + np.arange(long.sum())
        points = np.concatenate([points, 0.5 * (points[ends[long, 0]] + points[ends[long, 1]])])
        triangles, part = divide_triangles(triangles, number[of])
        origin = origin[part]


def untouchable(mesh: Mesh, closest: MeshClosestPoint, radius: float) -> np.ndarray:
    """Whether no ball of the radius [m] touches the middle of each triangle (T,) of a mesh with edges of at most
    `SHORT` of the radius; `closest` finds the nearest points of the whole body."""
    length = np.linalg.norm(mesh.face_vectors, axis=1)
    normal = mesh.face_vectors / np.where(length > 0.0, length, 1.0)[:, None]
    middle = einsum("tkc,k->tc", mesh.vertices[mesh.triangles], np.full(3, 1.0 / 3.0))
    centre = middle + radius * normal
    foot, _, _, signed = closest.find_along(centre)
    away = signed if closest.mesh.closed else np.linalg.norm(centre - foot, axis=1)  # a sheet has no inside
    return (away < radius - SLACK) & (length > 0.0)
