"""Contraction of the short edges of thin triangles, to their first end.

The ends of a short edge have different normals, which would bend the long sides apart when the mesh is divided, and the
triangle between them would be inclined by up to 88 degrees to the surface.
"""

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.geometry.refined.edges import CREASE, directions, is_thin

THIN = 0.1  # [1] length of an edge that is contracted, over the longest side of a triangle there


def contract_edges(mesh: Mesh, shortest: float, *stay: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """The mesh with both ends of each edge at one of them that is below `shortest` [m] and, in one of its triangles,
    below `THIN` of the longest side; the same object if no edge is. Edges remain that are part of a longer chain, as on
    a cylinder of long strips, or whose contraction would join more than two triangles at an edge, or fold them.

    stay  (n) vertices at which an edge ends, rather than at others; at those given first, rather than at the next

    Also the vertex of the result (V) that each becomes, -1: none.
    """
    count = len(mesh.vertices)
    ends, of, _ = edges_of(mesh.triangles.astype(np.int64), count)
    length = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    longest = np.zeros(len(ends))
    np.maximum.at(longest, of.ravel(), np.repeat(length[of].max(axis=1), 3))
    short = ends[(length < shortest) & (length <= THIN * longest)]
    if not len(short):
        return mesh, np.arange(count)
    graph = scipy.sparse.coo_array((np.ones(len(short), bool), tuple(short.T)), shape=(count, count))
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    rank = np.full(count, len(stay))
    for k in reversed(range(len(stay))):
        rank[stay[k]] = k
    order = np.argsort(rank, kind="stable")
    first = order[np.unique(label[order], return_index=True)[1]][label]
    kept = np.zeros(count, bool)  # by label
    kept[label[np.linalg.norm(mesh.vertices - mesh.vertices[first], axis=1) > 2.0 * shortest]] = True
    kept |= np.bincount(label, minlength=count) < 2
    while not kept[label].all():
        becomes = np.where(kept[label], np.arange(count), first)
        corners = becomes[mesh.triangles]
        remains = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
        whole = corners[remains]
        if not len(whole):
            return mesh, np.arange(count)
        before = mesh.triangles[remains]
        moved = (whole != before).any(axis=1)
        folded = before[moved][_is_folded(mesh.vertices, before[moved], whole[moved])]
        wrong = label[np.concatenate([_joined_twice(whole, count), folded.ravel()])]
        if kept[wrong].all():
            used = np.flatnonzero(np.bincount(whole.ravel(), minlength=count))
            number = np.full(count, -1)
            number[used] = np.arange(len(used))
            contracted = Mesh(mesh.vertices[used], np.ascontiguousarray(number[whole], dtype=np.int32))
            return contracted, number[becomes]
        kept[wrong] = True
    return mesh, np.arange(count)


def _joined_twice(triangles: np.ndarray, count: int) -> np.ndarray:
    """Vertices (n) of triangles (T,3) of `count` vertices that occur twice, and of edges of more than two triangles."""
    ends, of, _ = edges_of(triangles, count)
    number = np.bincount(of.ravel(), minlength=len(ends))
    # the first edge in ascending order is that of the two lower corners
    key = of.min(axis=1) * count + triangles.max(axis=1)
    ordered = np.sort(key)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    repeated = triangles[np.isin(key, twice)] if len(twice) else triangles[:0]
    return np.concatenate([repeated.ravel(), ends[number > 2].ravel()])


def _is_folded(points: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Whether each triangle (T) of points [m] (V,3) turns by more than 40 degrees, unless it was too thin for a
    normal."""
    turned = einsum("ij,ij->i", directions(points, before), directions(points, after)) < CREASE
    return np.asarray(turned & ~is_thin(points, before))
