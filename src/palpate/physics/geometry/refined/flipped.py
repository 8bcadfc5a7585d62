"""Flips of edges that remove obtuse triangles of a mesh.

A *cap* is a triangle with an angle above 120 degrees. If its middle corner lies next to its long side, a short distance
of that corner from the true surface, such as the 25 um by which marching cubes miss an ellipsoid in voxels of 2 mm,
inclines the triangle by tens of degrees. The long side is therefore replaced by the other diagonal of the two triangles
that meet there, where their angles opposite to it have a sum above 180 degrees (the criterion of Delaunay; on surfaces:
R. Dyer, H. Zhang, T. Möller, Symposium on Geometry Processing 2007, 163-172). Vertices remain. Between 110 and 150
degrees the limit hardly matters.

A flip moves the surface by up to the distance of the two diagonals, and so do those that follow it. On marching cubes
of images, voxels of 1 to 3 mm, all flips together move it by 2 % of an edge, 56 um at most. On the long strips of a
tube they would walk round it, and cut off up to 3 mm of its radius: they end at `MOVED` of an edge.
"""

import numpy as np

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.records import put, vector
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector3
from palpate.physics.geometry.refined.edge_list import edges_of, stable_order
from palpate.physics.geometry.refined.edges import CREASE, THINNEST, direction, too_thin
from palpate.physics.geometry.refined.key_set import add_key, has_key, remove_key, set_of_keys

FLAT = -0.5  # [1] cosine of the angle from which a triangle is a cap
ROUNDS = 30  # of flips of edges that have no triangle in common
MOVED, FARTHEST = 0.05, 1e-4  # [1] of the median edge, and [m]: motion of the surface by all flips of a triangle
_NAMES = ("cap", "other", "before", "after", "c", "a", "b", "d", "long", "ca", "bc", "ad", "db", "new")
FLIP = np.dtype([*((name, "<i8") for name in _NAMES), ("flatness", "<f8"), ("moved", "<f8")])
"""A cap and the triangle across its long side; the triangles across the other sides, ca and bc; the corner c of the
cap's largest angle, the ends a and b of its long side, and the corner d across it; the edges ab, `long`, ca, bc, ad and
db; the key of the edge cd; the cosine of the angle at c [1]; the motion of the surface by this and the flips before
[m]."""


def flip_caps(points: np.ndarray, triangles: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """The triangles (T,3) of points [m] (V,3) without caps; the same object if it has none.

    fixed  (K,2) ends, lower first, of edges that stay

    A cap stays at an edge of the border or of `fixed`, at one where the surface bends by more than 40 degrees, where
    the triangles in place of it would be at an angle of more than 40 degrees to those next to it, or join twice, and
    where the surface would move by more than `MOVED`.
    """
    points, count = np.ascontiguousarray(points), len(points)
    flat, apex = np.empty(len(triangles)), np.empty(len(triangles), np.int64)
    if not _find_caps(points, triangles, flat, apex):
        return triangles
    ends, of, two = edges_of(triangles, count)
    keys = ends[:, 0] * count + ends[:, 1]
    stays = np.zeros(len(keys), bool)
    place = np.minimum(np.searchsorted(keys, known := fixed[:, 0] * count + fixed[:, 1]), len(keys) - 1)
    stays[place[keys[place] == known]] = True
    flipped = triangles.copy()
    flips, best = np.zeros(len(triangles), FLIP), np.full(len(triangles), len(triangles))
    edge = float(np.median(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)))
    farthest, moved = min(MOVED * edge, FARTHEST), np.zeros(len(triangles))
    rounds = _flip(points, flipped, of, two, keys, stays, set_of_keys(keys), flat, apex, farthest, flips, best, moved)
    return flipped if rounds else triangles


@ieee_kernel
def _flip(
    points: Matrix, triangles: Indices, of: Indices, two: Indices, keys: Indices, stays: Indices, known: Indices,
    flat: Array, apex: Indices, farthest: float, flips: Record, best: Indices, moved: Array,
):  # fmt: skip
    """Flip the edges of caps in place, in rounds of flips that have no triangle in common, the flattest first; returns
    the number of rounds.

    of, two, keys  the edges, as of `edges_of`, and low * V + high of each;  stays (E,)  which of them stay
    known          set of the keys;  flat, apex  of `_find_caps`
    farthest [m]  motion of the surface at most
    flips (T,), best (T,), moved (T,)  workspaces, the second T and the third 0 everywhere
    """
    size = len(triangles)
    for number in range(ROUNDS):
        found = 0
        for cap in range(size):
            flip = flips[found]
            if flat[cap] < FLAT and _is_good(points, triangles, of, two, stays, known, flat, apex, cap, flip):
                flip.moved = max(moved[cap], moved[flip.other]) + _apart(points, flip)
                found += flip.moved <= farthest
        if found == 0:
            return number
        # of the flips that share a triangle or make the same edge, the flattest
        flatness, new = np.empty(found), np.empty(found, np.int64)
        for k in range(found):
            flatness[k] = flips[k].flatness
        order = stable_order(flatness)
        for k in range(found):
            new[k] = flips[order[k]].new
        repeated, by_key = np.zeros(found, np.bool_), stable_order(new)
        for k in range(1, found):
            repeated[by_key[k]] = new[by_key[k]] == new[by_key[k - 1]]
        for rank in range(found):
            if not repeated[rank]:
                flip = flips[order[rank]]
                for t in (flip.cap, flip.other, flip.before, flip.after):
                    best[t] = min(best[t], rank)
        for rank in range(found):
            flip = flips[order[rank]]
            one, other, before, after = flip.cap, flip.other, flip.before, flip.after
            if repeated[rank] or min(best[one], best[other], best[before], best[after]) < rank:
                continue
            if max(best[one], best[other], best[before], best[after]) > rank:
                continue
            _apply(triangles, of, two, keys, known, flip)
            for t in (one, other):
                flat[t], apex[t] = _flattest(points, triangles[t])
                moved[t] = flip.moved
        for k in range(found):
            flip = flips[k]
            for t in (flip.cap, flip.other, flip.before, flip.after):
                best[t] = size
    return ROUNDS


@ieee_kernel
def _is_good(
    points: Matrix, triangles: Indices, of: Indices, two: Indices, stays: Indices, known: Indices, flat: Array,
    apex: Indices, cap: int, flip: Record,
):  # fmt: skip
    """Whether the long side of a cap can be flipped; fills in the flip."""
    at, corners = apex[cap], triangles[cap]
    c, a, b = corners[at], corners[(at + 1) % 3], corners[(at + 2) % 3]
    long, ca, bc = of[cap, (at + 1) % 3], of[cap, at], of[cap, (at + 2) % 3]
    other = two[long, 0] + two[long, 1] - cap
    d = triangles[other, 0] + triangles[other, 1] + triangles[other, 2] - a - b
    if stays[long] or two[long, 0] == two[long, 1] or c == d or not 0 <= d < len(points):
        return False
    x, y = _corner(points[a], points[c], points[b])
    u, v = _corner(points[a], points[d], points[b])
    if not y * u + x * v < -1e-9 * abs(x * v):  # the sine of the sum of both angles
        return False
    along = direction(points, triangles[other, 0], triangles[other, 1], triangles[other, 2])
    first, second = direction(points, c, a, d), direction(points, c, d, b)
    if not (_smooth(first, along) and _smooth(second, along) and _smooth(first, second)):
        return False
    flip.before, flip.after = two[ca, 0] + two[ca, 1] - cap, two[bc, 0] + two[bc, 1] - cap
    for t in (flip.before, flip.after):
        i, j, k = vector(triangles[t])
        if (
            flat[t] >= FLAT
            and not too_thin(points, i, j, k, THINNEST)
            and not _smooth(direction(points, i, j, k), along)
        ):
            return False
    flip.new = min(c, d) * len(points) + max(c, d)
    if has_key(known, flip.new):
        return False
    at = 0 if triangles[other, 0] == d else (1 if triangles[other, 1] == d else 2)
    flip.db, flip.ad = of[other, at], of[other, (at + 2) % 3]
    if triangles[other, (at + 1) % 3] == a:
        flip.ad, flip.db = flip.db, flip.ad
    flip.cap, flip.other, flip.flatness = cap, other, flat[cap]
    flip.c, flip.a, flip.b, flip.d, flip.long, flip.ca, flip.bc = c, a, b, d, long, ca, bc
    return True


@ieee_kernel
def _apart(points: Matrix, flip: Record):
    """Distance [m] of the diagonals ab and cd of a flip."""
    a, b, c, d = points[flip.a], points[flip.b], points[flip.c], points[flip.d]
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    u, v, w = d[0] - c[0], d[1] - c[1], d[2] - c[2]
    p, q, r = y * w - z * v, z * u - x * w, x * v - y * u
    across = p * (c[0] - a[0]) + q * (c[1] - a[1]) + r * (c[2] - a[2])
    return abs(across) / max(np.sqrt(p * p + q * q + r * r), 1e-300)


@kernel
def _apply(triangles: Indices, of: Indices, two: Indices, keys: Indices, known: Indices, flip: Record):
    """Replace the two triangles of a flip, and their edges."""
    cap, other = flip.cap, flip.other
    put(triangles[cap], (flip.c, flip.a, flip.d))
    put(triangles[other], (flip.c, flip.d, flip.b))
    put(of[cap], (flip.ca, flip.ad, flip.long))
    put(of[other], (flip.long, flip.db, flip.bc))
    for i in range(2):
        if two[flip.ad, i] == other:
            two[flip.ad, i] = cap
        if two[flip.bc, i] == cap:
            two[flip.bc, i] = other
    remove_key(known, keys[flip.long])
    keys[flip.long] = flip.new
    add_key(known, flip.new)


@ieee_kernel
def _find_caps(points: Matrix, triangles: Indices, flat: Array, apex: Indices):
    """Fill in the cosine of the largest angle of each triangle [1] (T,), and at which corner it is; returns whether one
    is a cap."""
    found = False
    for t in range(len(triangles)):
        flat[t], apex[t] = _flattest(points, triangles[t])
        found = found or flat[t] < FLAT
    return found


@ieee_kernel
def _flattest(points: Matrix, corners: Indices):
    """The cosine of the largest angle of a triangle [1], and at which corner it is."""
    least, apex = np.inf, 0
    for k in range(3):
        x, y = _corner(points[corners[(k + 1) % 3]], points[corners[k]], points[corners[(k + 2) % 3]])
        cosine = x / max(np.sqrt(x * x + y * y), 1e-300)
        if cosine < least:
            least, apex = cosine, k
    return least, apex


@kernel
def _smooth(one: Vector3, other: Vector3):
    """Whether the angle between unit normals is below 40 degrees."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2] > CREASE


@ieee_kernel
def _corner(a: Array, b: Array, c: Array):
    """Cosine and sine of the angle at b between a and c (3), times the lengths of both sides [m²]."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    u, v, w = c[0] - b[0], c[1] - b[1], c[2] - b[2]
    p, q, r = y * w - z * v, z * u - x * w, x * v - y * u
    return x * u + y * v + z * w, np.sqrt(p * p + q * q + r * r)
