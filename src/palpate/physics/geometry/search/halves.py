"""The order of points for a complete tree: each node halves its points across the longest side of their box.

A node of a Morton curve often has two parts that are far from each other, and its bound is then wide: a search for the
nearest triangle visited two to three times as many nodes.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices, Matrix

SEED, FACTOR, TERM, MASK = 1, 1103515245, 12345, (1 << 31) - 1  # of the pivots, so that no order of points is slow


def halved_order(points: np.ndarray, leaves: int) -> np.ndarray:
    """The order (n) of points (n,3) in the leaves of a complete tree, a power of 2: leaf k has those from k n // leaves
    on. The first point stays the first. Of equal coordinates the one with the lower index comes first."""
    order = np.arange(len(points))
    _halve(np.ascontiguousarray(points, dtype=float), leaves, order)
    return order


@kernel
def _halve(points: Matrix, leaves: int, order: Indices):
    """Order the points of each node (1 to leaves - 1) by those of its two halves, of which the first has point 0."""
    count, row = len(points), leaves  # leaves below each node of the level
    for node in range(1, leaves):
        if node * row >= 2 * leaves:
            row //= 2
        first = node * row - leaves
        begin, end = first * count // leaves, (first + row) * count // leaves
        middle = (first + row // 2) * count // leaves
        if not begin < middle < end:
            continue
        widest, axis = -1.0, 0
        for i in range(3):
            low = high = points[order[begin], i]
            for k in range(begin + 1, end):
                low, high = min(low, points[order[k], i]), max(high, points[order[k], i])
            if high - low > widest:
                widest, axis = high - low, i
        _select(points, axis, 1.0, order, begin, end - 1, middle)
        if begin == 0 and order[:middle].min() > 0:
            _select(points, axis, -1.0, order, begin, end - 1, middle)
            if order[middle] == 0:  # the middle one is in neither half
                order[middle - 1], order[middle] = 0, order[middle - 1]
    for k in range(len(order)):
        if order[k] == 0:
            order[k], order[0] = order[0], 0
            break


@kernel
def _select(points: Matrix, axis: int, sign: float, order: Indices, begin: int, last: int, place: int):
    """Order the points from `begin` to `last` so that those before a place are below those from there on along an axis
    with this sign (C. A. R. Hoare, Commun. ACM 4 (1961) 321)."""
    random = SEED
    while begin < last:
        random = (random * FACTOR + TERM) & MASK
        pivot = order[begin + random % (last - begin + 1)]
        i, j = begin, last
        while i <= j:
            while _below(points, axis, sign, order[i], pivot):
                i += 1
            while _below(points, axis, sign, pivot, order[j]):
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i, j = i + 1, j - 1
        if place <= j:
            last = j
        elif place >= i:
            begin = i
        else:
            return


@kernel
def _below(points: Matrix, axis: int, sign: float, one: int, other: int):
    x, y = sign * points[one, axis], sign * points[other, axis]
    return x < y or (x == y and one < other)
