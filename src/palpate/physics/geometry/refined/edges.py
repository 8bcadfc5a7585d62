"""Edges of a triangle mesh, the directions of its triangles, and where its surface is not smooth."""

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Indices, Matrix
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.refined.edge_list import edges_of

CREASE = 0.766  # [1] cosine of 40 degrees, between the normals of two triangles
BEND = 0.45  # [1] length of the sum of two unit vectors at an angle of 154 degrees
SAME = 0.99996  # [1] cosine of 0.5 degrees
THINNEST = 0.004  # [1] height over the longest side below which the normal of a triangle is not known
FLATTEST = 0.065  # [1] the same of a cap, at 165 degrees, whose normal is not that of the surface if vertices scatter


def directions(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals of triangles (T,3); zero of those without area."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return unit(np.cross(b - a, c - a))


def unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])


def is_thin(points: np.ndarray, triangles: np.ndarray, thinnest: float = THINNEST) -> np.ndarray:
    """Whether each triangle (T) of points [m] (V,3) is too thin for a normal: its height is below `thinnest` [1] of its
    longest side."""
    thin = np.empty(len(triangles), bool)
    _find_thin(np.ascontiguousarray(points), np.ascontiguousarray(triangles, np.int64), thinnest, thin)
    return thin


def known_normals(points: np.ndarray, triangles: np.ndarray, two: np.ndarray, thinnest: float = THINNEST) -> np.ndarray:
    """Whether the normal of each triangle (T) is known: it is not too thin for one, or has the same as its neighbour,
    directly or through others, which is known. Flat sides are often divided into thin triangles.

    two  (E,2) triangles of each edge, as of `edges_of`;  thinnest  as of `is_thin`
    """
    thin, facing = is_thin(points, triangles, thinnest), directions(points, triangles)
    near = two[thin[two].any(axis=1)]
    near = near[einsum("ij,ij->i", facing[near[:, 0]], facing[near[:, 1]]) > SAME]
    graph = scipy.sparse.coo_array((np.ones(len(near), bool), tuple(near.T)), shape=(len(thin), len(thin)))
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    known = np.zeros(len(thin), bool)
    known[label[~thin]] = True
    return np.asarray(known[label])


def steep_edges(mesh: Mesh) -> np.ndarray:
    """Ends (K,2), lower first, of the edges at which the surface bends by more than 40 degrees, also if vertices
    scatter: not those of caps flatter than `FLATTEST`."""
    triangles = mesh.triangles.astype(np.int64)
    ends, _, two = edges_of(triangles, len(mesh.vertices))
    facing, known = directions(mesh.vertices, triangles), known_normals(mesh.vertices, triangles, two, FLATTEST)
    bend = einsum("ij,ij->i", facing[two[:, 0]], facing[two[:, 1]])
    return np.asarray(ends[(bend < CREASE) & known[two].all(axis=1)])


def turns_of(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """The ends (n) of these edges (K,2) of points [m] (V,3) at which they turn, by more than about 25 degrees: not
    those that they pass in a line."""
    along = unit(points[edges[:, 1]] - points[edges[:, 0]])
    away = np.zeros_like(points)  # sum of the unit vectors of the edges away from each vertex
    np.add.at(away, edges[:, 0], along)
    np.add.at(away, edges[:, 1], -along)
    number = np.bincount(edges.ravel(), minlength=len(points))
    return np.flatnonzero((number > 0) & ((number != 2) | (np.linalg.norm(away, axis=1) > BEND)))


def creases(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Ends (K,2), lower first, of the edges of the border and of those at which the surface bends by more
    than 40 degrees, and the vertices (C) whose normal differs by more from that of a triangle. Triangles that are too
    thin for a normal do not count."""
    triangles = mesh.triangles.astype(np.int64)
    ends, of, two = edges_of(triangles, len(mesh.vertices))
    facing, known = directions(mesh.vertices, triangles), known_normals(mesh.vertices, triangles, two)
    bend = einsum("ij,ij->i", facing[two[:, 0]], facing[two[:, 1]])
    border = np.bincount(of.ravel(), minlength=len(ends)) == 1
    off = np.asarray(einsum("ikj,ij->ik", mesh.normals[triangles], facing)) < CREASE
    sharp = border | ((bend < CREASE) & known[two].all(axis=1))
    return np.asarray(ends[sharp]), np.unique(triangles[off & known[:, None]])


@ieee_kernel
def direction(points: Matrix, i: int, j: int, k: int):
    """Unit normal of a triangle (`directions`) in a kernel."""
    x, y, z = _area(points, i, j, k)
    length = max(np.sqrt(x * x + y * y + z * z), 1e-300)
    return x / length, y / length, z / length


@ieee_kernel
def _find_thin(points: Matrix, triangles: Indices, thinnest: float, thin: Indices):
    """Fill in whether each triangle (T) is too thin for a normal."""
    for t in range(len(triangles)):
        thin[t] = too_thin(points, triangles[t, 0], triangles[t, 1], triangles[t, 2], thinnest)


@ieee_kernel
def too_thin(points: Matrix, i: int, j: int, k: int, thinnest: float):
    """Whether a triangle is too thin for a normal (`is_thin`), in a kernel."""
    x, y, z = _area(points, i, j, k)
    side = max(
        length_between(points[j], points[i]), length_between(points[k], points[j]), length_between(points[i], points[k])
    )
    return np.sqrt(x * x + y * y + z * z) <= thinnest * side * side


@kernel
def _area(points: Matrix, i: int, j: int, k: int):
    """Twice the area of a triangle times its normal [m²]."""
    a, b, c = points[i], points[j], points[k]
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    u, v, w = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return y * w - z * v, z * u - x * w, x * v - y * u


@ieee_kernel
def length_between(a: Array, b: Array):
    """Distance [m] of two points (3), in the order of `np.linalg.norm`."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return np.sqrt(x * x + y * y + z * z)
