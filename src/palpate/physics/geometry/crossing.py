"""Self-intersection of a triangle mesh: edges of a triangle through the interior of another one, or two triangles of a
piece that overlap in one plane, such as those of a concave polygon that was cut as a fan.

Where edges meet edges exactly, as between a piece and its mirror image, no edge passes through an interior. Two pieces
cross if this is found with one of them moved a little in a direction, and also in the opposite direction: pieces that
only touch are then apart.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix
from palpate.physics.errors import MeshError
from palpate.physics.geometry.bvh import LEAF
from palpate.physics.geometry.pieces import pieces
from palpate.physics.geometry.search.corners import boxes_of
from palpate.physics.geometry.search.morton import morton_order

MOST = 1_500_000_000
"""Largest number of tests of bounding boxes, about 10 s. A surface takes 100 to 200 per triangle; more only if many of
its triangles are at one place, such as those of a fan of a million slivers."""
UNFINISHED = -2
PLANE = 1e-6
"""[1] Distance over the size of the surface within which triangles are in one plane; files round it to 6e-8."""
ASIDE = 1e-7 * np.array([0.36, 0.48, 0.8])  # [1] By which a piece is moved, over the size of both


class UncheckedError(MeshError):
    """Too many triangles lie at the same place to test all pairs of them."""


def crossing(points: np.ndarray, triangles: np.ndarray) -> tuple[int, int, np.ndarray] | None:
    """Two triangles of which one has an edge through the interior of the other, or that overlap in a plane, and where
    [m] (3,); None: not found.

    Triangles that only touch do not cross, nor do those of two pieces that lie face to face. UncheckedError: more than
    `MOST` tests.
    """
    found = _search(points, triangles)
    return _between_pieces(points, triangles) if found is None and len(triangles) else found


def _between_pieces(points: np.ndarray, triangles: np.ndarray) -> tuple[int, int, np.ndarray] | None:
    """As `crossing`, of two pieces whose edges may meet exactly. Only triangles where both pieces are can cross."""
    label = pieces(triangles, len(points))
    parts = [np.flatnonzero(label == k) for k in range(int(label.max()) + 1)] if label.any() else []
    corner = points[triangles]
    least, most = corner.min(axis=1), corner.max(axis=1)
    low = np.array([least[part].min(axis=0) for part in parts])
    high = np.array([most[part].max(axis=0) for part in parts])
    tests = 0
    for one in range(len(parts)):
        near = (low[one + 1 :] <= high[one]).all(axis=1) & (low[one] <= high[one + 1 :]).all(axis=1)
        for other in (one + 1 + np.flatnonzero(near)).tolist():
            tests += 50 * (len(parts[one]) + len(parts[other]))
            if tests > MOST:
                raise UncheckedError(f"{len(parts)} pieces, of which too many lie at the same place to test all pairs")
            begin, end = np.maximum(low[one], low[other]), np.minimum(high[one], high[other])
            step = float((high[[one, other]].max(axis=0) - low[[one, other]].min(axis=0)).max()) * ASIDE
            mine, theirs = (
                part[((least[part] <= end + step) & (most[part] >= begin - step)).all(axis=1)]
                for part in (parts[one], parts[other])
            )
            both = np.concatenate([mine, theirs])
            used, local = np.unique(triangles[both], return_inverse=True)
            local, moved = local.reshape(-1, 3), np.unique(local.reshape(-1, 3)[len(mine) :])
            found = None
            for sign in (1.0, -1.0) if len(mine) and len(theirs) else ():
                shifted = np.array(points[used], dtype=np.float64)
                shifted[moved] += sign * step
                found = _search(shifted, local)
                if found is None:
                    break
            if found is not None:
                return int(both[found[0]]), int(both[found[1]]), found[2]
    return None


def _search(points: np.ndarray, triangles: np.ndarray) -> tuple[int, int, np.ndarray] | None:
    """As `crossing`, without edges that meet edges. Pairs are found by a complete tree of bounding boxes over the
    triangles along a Morton curve, in O(T log T)."""
    points, triangles = np.array(points, dtype=np.float64), np.ascontiguousarray(triangles, dtype=np.int64)
    middle = points[triangles].mean(axis=(0, 1))
    points -= middle  # far from the origin, rounding of the coordinates would exceed the tolerance of `_side`
    corner = points[triangles]
    near = PLANE * float(np.ptp(corner.reshape(-1, 3), axis=0).max()) if len(corner) else 0.0
    low, high = boxes_of(points, triangles)
    low, high = low - near, high + near
    label = pieces(triangles, len(points))
    centre = 0.5 * (low + high)
    order = morton_order(centre)
    boxes = np.ascontiguousarray(np.concatenate([low, -high], axis=1)[order])
    leaves = 1 << (-(-len(triangles) // LEAF) - 1).bit_length()
    at = np.zeros(3)
    tree = _tree(boxes, leaves)
    first, other = _crossing(points, triangles[order], label[order], near, boxes, tree, MOST, at)
    if first == UNFINISHED:
        raise UncheckedError(f"{len(triangles)} triangles, of which too many lie at the same place to test all pairs")
    return None if first < 0 else (int(order[first]), int(order[other]), at + middle)


@kernel
def _tree(boxes: Matrix, leaves: int):
    """Bounding box (2 leaves,6) of each node: lower corner, negative upper corner. Node k has the children 2k, 2k+1."""
    tree, count = np.full((2 * leaves, 6), np.inf), len(boxes)
    for node in range(2 * leaves - 1, 0, -1):
        if node >= leaves:
            for t in range((node - leaves) * count // leaves, (node - leaves + 1) * count // leaves):
                for i in range(6):
                    tree[node, i] = min(tree[node, i], boxes[t, i])
        else:
            for i in range(6):
                tree[node, i] = min(tree[2 * node, i], tree[2 * node + 1, i])
    return tree


@kernel
def _meet(a: Array, b: Array):
    """Whether two boxes share a point."""
    return a[0] <= -b[3] and b[0] <= -a[3] and a[1] <= -b[4] and b[1] <= -a[4] and a[2] <= -b[5] and b[2] <= -a[5]


@kernel
def _crossing(
    points: Matrix, triangles: Indices, label: Indices, near: float, boxes: Matrix, tree: Matrix, most: int, at: Array
):
    """The first pair; -1, -1: none; UNFINISHED: more than `most` tests. `at` (3) gets the place.

    label      (T,)  piece of each triangle; two of one piece may not overlap in a plane
    near [m]   see `PLANE`

    The triangles of a leaf share the search for the leaves near it. It begins at this leaf and continues at the
    right-hand neighbours of the nodes above it, so that each pair is tested once.
    """
    count, leaves, tests = len(triangles), len(tree) // 2, 0
    stack, near_leaf = np.empty(128, np.int64), np.empty(len(tree) // 2, np.int64)
    for leaf in range(leaves, 2 * leaves):
        stack[0], size, found = leaf, 1, 0
        above, box = leaf, tree[leaf]
        while above > 1:
            if above % 2 == 0 and _meet(tree[above + 1], box):
                stack[size] = above + 1
                size += 1
            above //= 2
            tests += 1
        while size > 0:
            size -= 1
            node = stack[size]
            if node >= leaves:
                near_leaf[found] = node - leaves
                found += 1
                continue
            for child in range(2 * node, 2 * node + 2):
                tests += 1
                if _meet(tree[child], box):
                    stack[size] = child
                    size += 1
        for i in range((leaf - leaves) * count // leaves, (leaf - leaves + 1) * count // leaves):
            for other in near_leaf[:found]:
                tests += 1
                if not _meet(tree[leaves + other], boxes[i]):
                    continue
                for j in range(max(other * count // leaves, i + 1), (other + 1) * count // leaves):
                    tests += 1
                    if _meet(boxes[j], boxes[i]) and (
                        _through(points, triangles[i], triangles[j], at)
                        or _through(points, triangles[j], triangles[i], at)
                        or (label[i] == label[j] and _overlap(points, triangles[i], triangles[j], near, at))
                    ):
                        return i, j
            if tests > most:
                return UNFINISHED, UNFINISHED
    return -1, -1


@kernel
def _side(a: Array, b: Array, c: Array, p: Array):
    """Six times the volume of the tetrahedron a, b, c, p, or 0 if rounding may have changed its sign: the filter of
    J. R. Shewchuk, Discrete Comput. Geom. 18 (1997) 305, with a larger tolerance because the vertices are rounded."""
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    w0, w1, w2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    volume = (u1 * v2 - u2 * v1) * w0 + (u2 * v0 - u0 * v2) * w1 + (u0 * v1 - u1 * v0) * w2
    terms = (
        (abs(u1 * v2) + abs(u2 * v1)) * abs(w0)
        + (abs(u2 * v0) + abs(u0 * v2)) * abs(w1)
        + (abs(u0 * v1) + abs(u1 * v0)) * abs(w2)
    )
    return volume if abs(volume) > 1e-12 * terms else 0.0


@kernel
def _through(points: Matrix, one: Indices, other: Indices, at: Array):
    """Whether an edge of one triangle passes through the interior of another one; `at` (3) gets the place."""
    a, b, c = points[other[0]], points[other[1]], points[other[2]]
    for k in range(3):
        m, n = one[k], one[(k + 1) % 3]
        shared = False
        for l in range(3):
            if other[l] == m or other[l] == n:
                shared = True
        if shared:
            continue
        p, q = points[m], points[n]
        above, below = _side(a, b, c, p), _side(a, b, c, q)
        if not above * below < 0.0:
            continue
        x, y, z = _side(p, q, a, b), _side(p, q, b, c), _side(p, q, c, a)
        if (x > 0.0 and y > 0.0 and z > 0.0) or (x < 0.0 and y < 0.0 and z < 0.0):
            share = above / (above - below)
            for l in range(3):
                at[l] = p[l] + share * (q[l] - p[l])
            return True
    return False


@kernel
def _overlap(points: Matrix, one: Indices, other: Indices, near: float, at: Array):
    """Whether two triangles are in one plane and share more than a strip of the width `near` [m]; `at` (3) gets the
    middle of the first. Two convex figures in a plane are apart if a side of one of them separates them."""
    a, b, c = points[one[0]], points[one[1]], points[one[2]]
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    size = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if size == 0.0:
        return False
    n0, n1, n2 = n0 / size, n1 / size, n2 / size
    for k in range(3):
        p = points[other[k]]
        if abs(n0 * (p[0] - a[0]) + n1 * (p[1] - a[1]) + n2 * (p[2] - a[2])) > near:
            return False
    for turn in range(2):
        mine, theirs = (one, other) if turn == 0 else (other, one)
        for k in range(3):
            p, q, r = points[mine[k]], points[mine[(k + 1) % 3]], points[mine[(k + 2) % 3]]
            # across the side p to q in the plane, away from the third corner
            e0, e1, e2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            m0, m1, m2 = e1 * n2 - e2 * n1, e2 * n0 - e0 * n2, e0 * n1 - e1 * n0
            length = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
            if length == 0.0:
                return False
            inside = m0 * (r[0] - p[0]) + m1 * (r[1] - p[1]) + m2 * (r[2] - p[2])
            if abs(inside) <= near * length:
                return False
            length = -length if inside > 0.0 else length
            least = np.inf
            for l in range(3):
                s = points[theirs[l]]
                least = min(least, (m0 * (s[0] - p[0]) + m1 * (s[1] - p[1]) + m2 * (s[2] - p[2])) / length)
            if least >= -near:
                return False
    for l in range(3):
        at[l] = (a[l] + b[l] + c[l]) / 3.0
    return True
