"""Nested dissection of a mesh: elimination order of the sparse factor, and the tree of dense fronts.

A part is divided by the smallest set of nodes that separates its two ends: a minimum cut between the first and last
nodes along a direction. Of several directions the one with the best size and balance of the cut is used.
A. George, SIAM J. Numer. Anal. 10 (1973) 345-363; A. Schild, C. Sommer, On balanced separators in road networks,
SEA 2015.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

LEAF = 32  # Number of nodes up to which a part is eliminated as one dense block
ENDS = 0.32  # Fraction of a part at each end that the cut does not divide
SMALL, TRIED = 150, 4  # Above this number of nodes, a part is cut only along the TRIED most promising directions
DIRECTIONS = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 0], [0, 1, 1], [0, 1, -1], [1, 0, 1], [1, 0, -1]]
)


@dataclass(frozen=True)
class Tree:
    """Fronts of a multifrontal factor in postorder; front t eliminates the nodes `order[first[t]:first[t + 1]]`."""

    order: np.ndarray  # (N,) nodes in order of elimination
    first: np.ndarray  # (T+1,) pivots of each front, as positions in `order`
    parent: np.ndarray  # (T,) front that takes the update of front t, -1 at a root
    boundary: np.ndarray  # (B,) positions coupled to the pivots of each front and eliminated later, sorted
    start: np.ndarray  # (T+1,) start of the boundary of front t in `boundary`


def dissect(points: np.ndarray, indptr: np.ndarray, indices: np.ndarray) -> Tree:
    """Elimination tree of nodes at `points` [m] (N,3), coupled by a symmetric pattern in CSR form."""
    graph = csr_array((np.ones(len(indices), dtype=np.int32), indices, indptr), shape=(len(points), len(points)))
    pivots: list[np.ndarray] = []
    parents: list[int] = []

    def visit(part: np.ndarray, inner: csr_array) -> int:
        cut = _cut(points[part], inner) if len(part) > LEAF else None
        children = []
        separator = part
        if cut is not None:
            for side in (0, 1):
                keep = np.flatnonzero(cut == side)
                children.append(visit(part[keep], inner[keep][:, keep]))
            separator = part[cut == 2]
        pivots.append(separator)
        parents.append(-1)
        for child in children:
            parents[child] = len(pivots) - 1
        return len(pivots) - 1

    visit(np.arange(len(points)), graph)
    return _boundaries(graph, pivots, parents)


def _cut(points: np.ndarray, graph: csr_array) -> np.ndarray | None:
    """Side of each node: 0, 1, or 2 for the separator; None: the part cannot be cut."""
    best, sides = np.inf, None
    count = len(points)
    for rank in _ranks(points, graph):
        side = _minimum_cut(graph, rank < ENDS, rank >= 1.0 - ENDS)
        if side is None:
            continue
        sizes = np.bincount(side, minlength=3)
        cost = sizes[2] * (1.0 + 0.5 * abs(sizes[0] - sizes[1]) / count)
        if cost < best and sizes[2] < count:
            best, sides = cost, side
    return sides


def _ranks(points: np.ndarray, graph: csr_array) -> list[np.ndarray]:
    """Rank of the nodes, from 0 to 1, along each direction to try: three of a small part, else those of `DIRECTIONS`
    with the fewest nodes next to the middle plane."""
    count = len(points)
    ranks = []
    for direction in DIRECTIONS if count > SMALL else DIRECTIONS[:3]:
        rank = np.empty(count)
        rank[np.argsort(points @ direction, kind="stable")] = np.arange(count) / count
        ranks.append(rank)
    if count <= SMALL:
        return ranks
    i = np.repeat(np.arange(count), np.diff(graph.indptr))
    sizes = []
    for rank in ranks:
        low = rank < 0.5
        sizes.append(len(np.unique(i[low[i] & ~low[graph.indices]])))
    return [ranks[k] for k in np.argsort(sizes, kind="stable")[:TRIED]]


def _minimum_cut(graph: csr_array, first: np.ndarray, last: np.ndarray) -> np.ndarray | None:
    """Smallest set of nodes that separates `first` from `last`, as in `_cut`, by maximum flow: each node is an arc of
    capacity 1, each end is merged into one node."""
    # network: node k has the arc k -> count + k
    count = len(first)
    i = np.repeat(np.arange(count), np.diff(graph.indptr))
    j = graph.indices
    source, sink, endless = 2 * count, 2 * count + 1, count
    enter, leave = np.arange(count), np.arange(count) + count
    enter, leave = np.where(first, source, enter), np.where(first, source, leave)
    enter, leave = np.where(last, sink, enter), np.where(last, sink, leave)
    middle = np.flatnonzero(~first & ~last)
    a, b = leave[i], enter[j]
    crossing = (a != b) & (a != sink) & (b != source)
    if (crossing & (a == source) & (b == sink)).any():
        # the ends are adjacent: remove the adjacent nodes from one end
        touching = np.unique(i[first[i] & last[j]])
        smaller = first.copy()
        smaller[touching] = False
        return _minimum_cut(graph, smaller, last) if smaller.any() else None
    rows = np.concatenate([middle, a[crossing]])
    columns = np.concatenate([middle + count, b[crossing]])
    capacity = np.concatenate([np.ones(len(middle)), np.full(crossing.sum(), endless)]).astype(np.int32)
    net = csr_array((capacity, (rows, columns)), shape=(2 * count + 2, 2 * count + 2))
    net.data = np.minimum(net.data, endless)
    flow = maximum_flow(net, source, sink).flow
    # minimum cut: arcs from nodes that the source reaches in the residual network to others
    residual = (net - flow).tocsr()
    residual.data = (residual.data > 0).astype(np.int32)
    residual.eliminate_zeros()
    reached = np.zeros(2 * count + 2, dtype=bool)
    reached[breadth_first_order(residual, source, return_predecessors=False)] = True
    side = np.ones(count, dtype=np.int64)
    side[first] = 0
    inside, outside = reached[middle], reached[middle + count]
    side[middle[outside]] = 0
    side[middle[inside & ~outside]] = 2
    return side


def _boundaries(graph: csr_array, pivots: list[np.ndarray], parents: list[int]) -> Tree:
    """Symbolic factorisation: the boundary of each front is that of its pivots and of its children's boundaries."""
    order = np.concatenate(pivots)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    first = np.concatenate([[0], np.cumsum([len(p) for p in pivots])])
    passed: list[list[np.ndarray]] = [[] for _ in pivots]
    rows = []
    for t, nodes in enumerate(pivots):
        near = place[graph[nodes].indices] if len(nodes) else np.zeros(0, dtype=np.int64)
        boundary = np.unique(np.concatenate([near, *passed[t]]))
        boundary = boundary[boundary >= first[t + 1]]
        rows.append(boundary)
        if parents[t] >= 0:
            passed[parents[t]].append(boundary)
    start = np.concatenate([[0], np.cumsum([len(r) for r in rows])])
    return Tree(order, first, np.array(parents), np.concatenate(rows), start)
