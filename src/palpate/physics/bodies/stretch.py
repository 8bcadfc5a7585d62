"""Limit on the difference of displacement between neighbours on a surface, which prevents folding.

Displacements keep their directions and are shortened, as little as possible, until

    |u_i - u_j| <= limit * length of the edge ij

on all edges. Lengths only decrease, each as little as its neighbours require, so the result does not depend on the
order and is continuous under a moving load.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Indices, Matrix
from palpate.physics.geometry.mesh import Mesh, once_per_mesh

EXCESS = 1e-9  # [1] Tolerance of the limit
ROUNDS = 60  # Maximum number of updates of a length, on average


class Neighbours(NamedTuple):
    """Adjacency of the nodes."""

    first: Annotated[np.ndarray, "<i8", 1]  # [1] (V+1) index in `others` of the first neighbour of each node
    others: Annotated[np.ndarray, "<i4", 1]  # [1] (E) nodes that share an edge with it
    spans: Annotated[np.ndarray, "<f8", 1]  # [m] (E) length of that edge, > 0


@once_per_mesh
def neighbours(mesh: Mesh) -> Neighbours:
    """The neighbours of each vertex of a mesh, in ascending order."""
    size = len(mesh.vertices)
    edges = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]].astype(np.int64)
    pairs = np.sort(np.concatenate([edges[:, k] * size + edges[:, 1 - k] for k in (0, 1)]))
    owner, others = np.divmod(pairs[np.diff(pairs, prepend=-1) != 0], size)
    first = np.searchsorted(owner, np.arange(size + 1))
    spans = np.linalg.norm(mesh.vertices[owner] - mesh.vertices[others], axis=1)
    return Neighbours(first, others.astype(np.int32), np.maximum(spans, 1e-9))


class StretchWorkspace(NamedTuple):
    """Workspace of `limit_stretch`: lengths [m] (V), a queue of slots (V), and flags of those in it (V)."""

    lengths: Annotated[np.ndarray, "<f8", 1]
    queue: Annotated[np.ndarray, "<i8", 1]
    queued: Annotated[np.ndarray, "|b1", 1]

    @classmethod
    def of(cls, size: int) -> StretchWorkspace:
        return cls(np.zeros(size), np.zeros(max(size, 1), np.int64), np.zeros(size, np.bool_))


@ieee_kernel
def _apart(vectors: Matrix, i: int, j: int):
    x, y, z = vectors[i, 0] - vectors[j, 0], vectors[i, 1] - vectors[j, 1], vectors[i, 2] - vectors[j, 2]
    return x * x + y * y + z * z


@ieee_kernel
def _excess(
    vectors: Matrix, count: int, limit: float, least: float, edges: Neighbours, place: Indices, nodes: Indices,
    squares: Array,
):  # fmt: skip
    """Smallest ratio [1] of limit to difference over the edges of the listed nodes, 1 if all are within the limit; a
    node that is not listed is at rest.

    The longer vector of a pair that exceeds the limit is at least half as long as the difference. So only edges with
    a vector above half the limit of the shortest edge, `least` [m], are examined. squares (V): workspace
    """
    worst, least = 1.0, 0.25 * limit * limit * least * least
    for slot in range(count):
        squares[slot] = _square(vectors, slot)
    for slot in range(count):
        if squares[slot] <= least:
            continue
        node = nodes[slot]
        for at in range(edges.first[node], edges.first[node + 1]):
            other = place[edges.others[at]]
            if 0 <= other < slot and squares[other] > least:
                continue  # examined from the other end
            square = _apart(vectors, slot, other) if other >= 0 else squares[slot]
            most = limit * edges.spans[at]
            if square > most * most * (1.0 + EXCESS):
                worst = min(worst, most / math.sqrt(square))
    return worst


@ieee_kernel
def _square(vectors: Matrix, i: int):
    return vectors[i, 0] ** 2 + vectors[i, 1] ** 2 + vectors[i, 2] ** 2


@ieee_kernel
def _shorten_pair(a: float, b: float, cosine: float, most: float):
    """Lengths of two vectors at a given angle, a >= b, shortened until their difference is at most `most`."""
    if a * a + b * b - 2.0 * a * b * cosine <= most * most * (1.0 + EXCESS):
        return a, b
    rest = most * most - b * b * (1.0 - cosine * cosine)
    longest = b * cosine + math.sqrt(rest) if rest > 0.0 else -1.0
    if longest >= b:
        return min(a, longest), b
    both = min(most / math.sqrt(max(2.0 - 2.0 * cosine, 1e-300)), b)
    return both, both


@ieee_kernel
def limit_stretch(
    vectors: Matrix, count: int, limit: float, least: float, edges: Neighbours, place: Indices, nodes: Indices,
    room: StretchWorkspace,
):  # fmt: skip
    """Shorten vectors [m] (count,3) of the listed nodes until neighbours differ by at most `limit` edge lengths.
    Returns the number of shortened ones.

    least [m]  length of the shortest edge;  place (V)  slot of each node or -1;  nodes (count)  node of each slot
    """
    if _excess(vectors, count, limit, least, edges, place, nodes, room.lengths) == 1.0:
        return 0
    lengths, queue, queued = room.lengths, room.queue, room.queued
    for slot in range(count):
        lengths[slot] = math.sqrt(_square(vectors, slot))
        queue[slot] = slot
        queued[slot] = True
    head, waiting, left = 0, count, ROUNDS * count
    while waiting > 0 and left > 0:
        i = queue[head]
        head = head + 1 if head + 1 < count else 0
        waiting -= 1
        left -= 1
        queued[i] = False
        node, before = nodes[i], lengths[i]
        for at in range(edges.first[node], edges.first[node + 1]):
            j = place[edges.others[at]]
            most = limit * edges.spans[at]
            if j < 0:
                lengths[i] = min(lengths[i], most)
                continue
            a, b = lengths[i], lengths[j]
            if a + b <= most:
                continue
            across = math.sqrt(_square(vectors, i) * _square(vectors, j))
            along = vectors[i, 0] * vectors[j, 0] + vectors[i, 1] * vectors[j, 1] + vectors[i, 2] * vectors[j, 2]
            cosine = min(max(along / across, -1.0), 1.0) if across > 0.0 else 0.0
            longer, shorter = _shorten_pair(max(a, b), min(a, b), cosine, most)
            lengths[i], lengths[j] = (longer, shorter) if a >= b else (shorter, longer)
            if lengths[j] < b and not queued[j]:
                queue[(head + waiting) % count], queued[j] = j, True
                waiting += 1
        if lengths[i] < before and not queued[i]:
            # neighbours that were processed before this length decreased must be processed again
            queue[(head + waiting) % count], queued[i] = i, True
            waiting += 1
    return _shorten(vectors, count, limit, least, edges, place, nodes, room)


@ieee_kernel
def _shorten(
    vectors: Matrix, count: int, limit: float, least: float, edges: Neighbours, place: Indices, nodes: Indices,
    room: StretchWorkspace,
):  # fmt: skip
    """Apply the lengths. If the limit on updates was reached, scale all vectors by the remaining excess."""
    shorter = 0
    for slot in range(count):
        length = math.sqrt(_square(vectors, slot))
        room.queued[slot] = False
        if room.lengths[slot] < length * (1.0 - EXCESS):
            shorter += 1
            for k in range(3):
                vectors[slot, k] *= room.lengths[slot] / length
    worst = _excess(vectors, count, limit, least, edges, place, nodes, room.lengths)
    if worst < 1.0:
        shorter = count
        for slot in range(count):
            for k in range(3):
                vectors[slot, k] *= worst
    return shorter
