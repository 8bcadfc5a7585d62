"""Geometric nested dissection of a mesh: the elimination order of its sparse factor, and the tree of dense fronts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAF = 40
"""Nodes below which a part is eliminated as one dense block."""


@dataclass(frozen=True)
class Tree:
    """Fronts of a multifrontal factor in postorder; front t eliminates the nodes `order[first[t]:first[t + 1]]`.

    order     (N,)    nodes in order of elimination
    first     (T+1,)  pivots of each front, as positions in `order`
    parent    (T,)    front that takes the update of front t, -1 at a root
    boundary  (B,)    positions coupled to the pivots of each front and eliminated later, sorted
    start     (T+1,)  where the boundary of front t stands in `boundary`
    """

    order: np.ndarray
    first: np.ndarray
    parent: np.ndarray
    boundary: np.ndarray
    start: np.ndarray


def dissect(points: np.ndarray, elements: np.ndarray) -> Tree:
    """Elimination tree of a mesh whose elements couple all their nodes.

    Elements are split by planes across the axes; the nodes that both halves share are
    the separator. Of several cuts near the middle the one with the least separator for its balance is taken.

    points    [m] (N,3)
    elements  (E,k) node indices; -1 fills up an element of fewer nodes

    A. George, SIAM J. Numer. Anal. 10 (1973) 345-363.
    """
    count = len(points)
    nodes_in = [row[row >= 0] for row in elements] if (elements < 0).any() else elements
    centre = np.array([points[row].mean(axis=0) for row in nodes_in]) if isinstance(nodes_in, list) else None
    if centre is None:
        centre = points[elements].mean(axis=1)
    done = np.zeros(count, dtype=bool)
    pivots: list[np.ndarray] = []
    parents: list[int] = []
    members: list[np.ndarray] = []

    def split(part: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        inside = elements[part]
        best: tuple[float, np.ndarray] | None = None
        spread = np.ptp(centre[part], axis=0)
        for axis in np.flatnonzero(spread > 0.0):
            x = centre[part, axis]
            for share in (0.42, 0.46, 0.5, 0.54, 0.58):
                left = x < np.quantile(x, share)
                if left.all() or not left.any():
                    continue
                a, b = _nodes(inside[left], done), _nodes(inside[~left], done)
                shared = np.intersect1d(a, b, assume_unique=True)
                small = min(len(a), len(b)) - len(shared)
                if small <= 0:
                    continue
                cost = len(shared) * (1.0 + 2.0 * abs(len(a) - len(b)) / (len(a) + len(b)))
                if best is None or cost < best[0]:
                    best = cost, left
        if best is None:
            return None
        left = best[1]
        shared = np.intersect1d(_nodes(inside[left], done), _nodes(inside[~left], done), assume_unique=True)
        return part[left], part[~left], shared

    def visit(part: np.ndarray) -> int:
        own = _nodes(elements[part], done)
        cut = split(part) if len(own) > LEAF else None
        children = []
        if cut is not None:
            done[cut[2]] = True
            children = [visit(cut[0]), visit(cut[1])]
            own = cut[2]
        else:
            done[own] = True
        index = len(pivots)
        pivots.append(own)
        members.append(part)
        parents.append(-1)
        for child in children:
            if child >= 0:
                parents[child] = index
        return index

    visit(np.arange(len(elements)))
    lonely = np.flatnonzero(~done)
    if len(lonely):
        pivots.append(lonely)
        members.append(np.zeros(0, dtype=int))
        parents.append(-1)
    return _boundaries(count, elements, pivots, parents, members)


def _nodes(elements: np.ndarray, done: np.ndarray) -> np.ndarray:
    found = np.unique(elements)
    found = found[found >= 0]
    return found[~done[found]]


def _boundaries(count: int, elements: np.ndarray, pivots: list, parents: list, members: list) -> Tree:
    order = np.concatenate(pivots)
    place = np.empty(count, dtype=np.int64)
    place[order] = np.arange(count)
    first = np.concatenate([[0], np.cumsum([len(p) for p in pivots])])
    passed: list[list[np.ndarray]] = [[] for _ in pivots]
    rows = []
    for t, own in enumerate(pivots):
        near = elements[members[t]]
        if len(near):
            holds = np.zeros(count + 1, dtype=bool)
            holds[own] = True
            near = place[np.unique(near[holds[near].any(axis=1)])[0 if (near >= 0).all() else 1 :]]
        found = np.unique(np.concatenate([near.ravel().astype(np.int64), *passed[t]]))
        found = found[found >= first[t + 1]]
        rows.append(found)
        if parents[t] >= 0:
            passed[parents[t]].append(found)
        elif len(found):
            raise AssertionError("a root front has a boundary")
    start = np.concatenate([[0], np.cumsum([len(r) for r in rows])])
    return Tree(order, first, np.array(parents), np.concatenate(rows), start)
