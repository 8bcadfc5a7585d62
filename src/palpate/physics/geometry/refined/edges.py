"""Edges of a triangle mesh, the directions of its triangles, and where its surface is not smooth."""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh

CREASE = 0.766  # [1] cosine of 40 degrees, between the normals of two triangles
THINNEST = 0.004  # [1] height over the longest side below which the normal of a triangle is not known


def edges_of(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends (E,2) of each edge, the lower first; the edges of each triangle (T,3), the first between its first two
    corners; two triangles of each edge (E,2), the same twice at a border."""
    begin, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    key, first, of = np.unique(low * count + high, return_index=True, return_inverse=True)
    last = np.zeros(len(key), dtype=np.int64)
    last[of.ravel()] = np.arange(len(begin)) // 3
    return np.stack([key // count, key % count], 1), of.reshape(-1, 3), np.stack([first // 3, last], 1)


def directions(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals of triangles (T,3); zero of those without area."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return unit(np.cross(b - a, c - a))


def unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])


def is_thin(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Whether each triangle (T) of points [m] (V,3) is too thin for a normal."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    side = np.max([np.linalg.norm(each, axis=1) for each in (b - a, c - b, a - c)], axis=0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) <= THINNEST * side * side)


def creases(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Ends (K,2), lower first, of the edges of the border and of those at which the surface bends by more
    than 40 degrees, and the vertices (C) whose normal differs by more from that of a triangle. Triangles that are too
    thin for a normal do not count."""
    triangles = mesh.triangles.astype(np.int64)
    ends, of, two = edges_of(triangles, len(mesh.vertices))
    facing, known = directions(mesh.vertices, triangles), ~is_thin(mesh.vertices, triangles)
    bend = einsum("ij,ij->i", facing[two[:, 0]], facing[two[:, 1]])
    border = np.bincount(of.ravel(), minlength=len(ends)) == 1
    off = np.asarray(einsum("ikj,ij->ik", mesh.normals[triangles], facing)) < CREASE
    sharp = border | ((bend < CREASE) & known[two].all(axis=1))
    return np.asarray(ends[sharp]), np.unique(triangles[off & known[:, None]])
