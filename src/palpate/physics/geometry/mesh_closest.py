"""Closest point of a triangle mesh: tree search, and the Voronoi regions of a triangle.

C. Ericson, Real-Time Collision Detection, Morgan Kaufmann 2005, sec. 5.1.5 (closest point of a triangle).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.compiler.fields import blank_record, element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Indices, Matrix, Record
from palpate.physics.geometry.bvh import MeshTables, mesh_tables
from palpate.physics.geometry.closest import FAR
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.pseudonormal import EDGE, FACE, VERTEX, foot_of, normal_at, signed_distance
from palpate.physics.geometry.search.foot import FOOT, find_feet
from palpate.physics.geometry.search.morton import morton_order

STACK = 128  # nodes of the tree that wait for the search
WAITING = element_type({"node": int, "away": ()})
"""A node of the tree that waits for the search, and its squared distance [m²] from the point."""
TRACKED = {"exists": bool, "triangle": int, "nearest": int}
"""From step to step: whether a last foot point exists, and its triangle. Of the last step: that of the nearest
point."""


@dataclass(frozen=True, eq=False)
class MeshClosestPoint:
    """Finds and tracks closest points of a mesh: `find` for independent points, `track_mesh` with `tables.arrays` for
    one moving point. The tree is built at the first use."""

    mesh: Mesh

    @cached_property
    def tables(self) -> MeshTables:
        """ValueError: a mesh without triangles, or whose vertices are not finite."""
        return mesh_tables(self.mesh.vertices, self.mesh.triangles, self.mesh.facing)

    def scratch(self) -> tuple[Record, np.ndarray, Record]:
        """State, workspace and result of `track_mesh`."""
        return blank_record(TRACKED), np.zeros(STACK, WAITING), blank_record(FOOT)

    def find(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Foot points [m] (...,3), outward normals [1] (...,3), triangles (...) and signed distances [m] (...),
        positive outside, of points [m] (...,3)."""
        return self._find(points, False)

    def find_along(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """As `find`, 4 times as fast for points of which each is near the one before. Of equally near places the result
        is the one next to that of the point before."""
        return self._find(points, True)

    def find_sorted(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """As `find_along` of points (n,3) in any order, along a Morton curve. Of equally near places, as on the middle
        plane of a groove, the result may be another one than for the neighbours of a point."""
        order = morton_order(points)
        back = np.empty(len(order), np.int64)
        back[order] = np.arange(len(order))
        foot, normal, triangle, distance = (each[back] for each in self._find(points[order], True))
        return foot, normal, triangle, distance

    def farthest(self, points: np.ndarray) -> tuple[float, int]:
        """Largest distance [m] of points (n,3) from the mesh, and the index of that point, in less time than by `find`:
        no search is needed where the descent from the last foot ends nearer than an earlier point was."""
        order = morton_order(points)
        ordered = np.ascontiguousarray(points[order], dtype=float)
        distance, at = _farthest(*self.tables.arrays, ordered, np.zeros(STACK, WAITING))
        return float(distance), int(order[at])

    def beyond(self, points: np.ndarray, distance: float) -> np.ndarray:
        """Whether each of the points [m] (n,3) is farther than the distance [m] from the mesh, in less time than by
        `find`: (n,)."""
        beyond, order = np.empty(len(points), bool), morton_order(points)
        found, ordered = np.empty(len(points), bool), np.ascontiguousarray(points[order], dtype=float)
        _farther(*self.tables.arrays, ordered, distance * distance, np.zeros(STACK, WAITING), found)
        beyond[order] = found
        return beyond

    def _find(self, points: np.ndarray, along: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        tables, scratch = self.tables.arrays, self.scratch()[:2]
        feet = find_feet(lambda each, found: _find(*tables, each, along, *scratch, found), points)
        return feet["point"], feet["normal"], feet["triangle"], feet["distance"]


@kernel
def track_mesh(
    points: Record,
    cells: Record,
    discs: Record,
    star_at: Indices,
    star: Indices,
    p0: float,
    p1: float,
    p2: float,
    hysteresis: float,
    tracked: Record,
    work: Record,
    foot: Record,
):
    """The foot of p = (p0, p1, p2) [m].

    Descent from the last foot point over neighbouring triangles gives the point of the same branch, whose distance
    bounds the tree search. The foot point remains on its branch until the search finds one nearer by more than the
    hysteresis [m]. The signed distance is that of the nearest point, on the triangle `tracked.nearest`.
    """
    p0, p1, p2 = min(max(p0, -FAR), FAR), min(max(p1, -FAR), FAR), min(max(p2, -FAR), FAR)
    local, settled = 0, False
    if tracked.exists:
        local, settled = _descend(points, cells, star_at, star, p0, p1, p2, tracked.triangle)
    f, v, w, place = _on_triangle(points, cells, local, p0, p1, p2)
    t = _search(points, cells, discs, p0, p1, p2, local, f, work)
    if t != local:
        g, x, y, spot = _on_triangle(points, cells, t, p0, p1, p2)
        signed = signed_distance(points, cells, star_at, star, t, x, y, spot, p0, p1, p2, foot)
        if not settled or np.sqrt(g) < np.sqrt(f) - hysteresis or _same(points, cells, local, t, v, w, x, y):
            local, v, w = t, x, y
        else:
            foot_of(points, cells, local, v, w, foot)
    else:
        signed = signed_distance(points, cells, star_at, star, local, v, w, place, p0, p1, p2, foot)
    normal_at(points, cells, local, v, w, foot)
    tracked.exists, tracked.triangle, tracked.nearest = True, local, t
    foot.place[0], foot.place[1], foot.distance, foot.triangle = v, w, signed, cells[local].origin


@kernel
def descend_mesh(
    points: Record,
    cells: Record,
    star_at: Indices,
    star: Indices,
    p0: float,
    p1: float,
    p2: float,
    tracked: Record,
    foot: Record,
):
    """`track_mesh` on the branch of the last foot point, of a point [m] that is not far from the mesh, in much less
    time. Returns whether the descent ended."""
    t, settled = _descend(points, cells, star_at, star, p0, p1, p2, tracked.triangle)
    _, v, w, place = _on_triangle(points, cells, t, p0, p1, p2)
    signed = signed_distance(points, cells, star_at, star, t, v, w, place, p0, p1, p2, foot)
    normal_at(points, cells, t, v, w, foot)
    tracked.triangle = tracked.nearest = t
    foot.place[0], foot.place[1], foot.distance, foot.triangle = v, w, signed, cells[t].origin
    return settled


@kernel
def _find(
    points: Record,
    cells: Record,
    discs: Record,
    star_at: Indices,
    star: Indices,
    queries: Matrix,
    along: bool,
    tracked: Record,
    work: Record,
    feet: Record,
):
    for k in range(len(queries)):
        tracked.exists, q = tracked.exists and along, queries[k]
        track_mesh(points, cells, discs, star_at, star, q[0], q[1], q[2], 0.0, tracked, work, feet[k])


@kernel
def _farthest(
    points: Record, cells: Record, discs: Record, star_at: Indices, star: Indices, queries: Matrix, work: Record
):
    """The largest distance [m] of the queries (n,3), and which of them has it."""
    most, t, farthest = 0.0, 0, 0
    for k in range(len(queries)):
        q = queries[k]
        t, _ = _descend(points, cells, star_at, star, q[0], q[1], q[2], t)
        f, _, _, _ = _on_triangle(points, cells, t, q[0], q[1], q[2])
        if f > most:
            t = _search(points, cells, discs, q[0], q[1], q[2], t, f, work)
            f, _, _, _ = _on_triangle(points, cells, t, q[0], q[1], q[2])
            if f > most:
                most, farthest = f, k
    return np.sqrt(most), farthest


@kernel
def _farther(
    points: Record, cells: Record, discs: Record, star_at: Indices, star: Indices, queries: Matrix, most: float,
    work: Record, found: Indices,
):  # fmt: skip
    """Fill in whether the squared distance of each of the queries (n,3) is above `most` [m²]."""
    t, limit = 0, most * (1.0 + 1e-12)
    for k in range(len(queries)):
        q = queries[k]
        t, _ = _descend(points, cells, star_at, star, q[0], q[1], q[2], t)
        f, _, _, _ = _on_triangle(points, cells, t, q[0], q[1], q[2])
        if f > most:
            best = _search(points, cells, discs, q[0], q[1], q[2], -1, limit, work)
            if best >= 0:
                t = best
                f, _, _, _ = _on_triangle(points, cells, t, q[0], q[1], q[2])
        found[k] = f > most


@kernel
def _same(points: Record, cells: Record, s: int, t: int, v: float, w: float, x: float, y: float):
    """Whether two points on triangles coincide, such as on the common edge of neighbours."""
    total, first, second = 0.0, vector(cells[s].corners), vector(cells[t].corners)
    for c in range(3):
        i, j, k = first
        a = points[i].position[c] * (1.0 - v - w) + points[j].position[c] * v + points[k].position[c] * w
        i, j, k = second
        b = points[i].position[c] * (1.0 - x - y) + points[j].position[c] * x + points[k].position[c] * y
        total += (a - b) * (a - b)
    return total < 1e-24


@kernel
def _segment(ax: float, ay: float, az: float, bx: float, by: float, bz: float):
    """Coordinate in [0, 1], from a to b, of the point of a segment that is nearest to the origin."""
    dx, dy, dz = bx - ax, by - ay, bz - az
    square = dx * dx + dy * dy + dz * dz
    if square <= 0.0:
        return 0.0
    return min(max(-(ax * dx + ay * dy + az * dz) / square, 0.0), 1.0)


@kernel
def _on_triangle(points: Record, cells: Record, t: int, p0: float, p1: float, p2: float):
    """Squared distance [m²], weights [1] of the second and third corner, and region of a triangle's nearest point."""
    i, j, k = vector(cells[t].corners)
    a, b, c = points[i].position, points[j].position, points[k].position
    ax, ay, az = a[0] - p0, a[1] - p1, a[2] - p2
    bx, by, bz = b[0] - p0, b[1] - p1, b[2] - p2
    cx, cy, cz = c[0] - p0, c[1] - p1, c[2] - p2
    v = w = 0.0
    if cells[t].kind > 0:
        edge = cells[t].kind - 1
        if edge == 0:
            v = _segment(ax, ay, az, bx, by, bz)
            s = v
        elif edge == 1:
            w = _segment(bx, by, bz, cx, cy, cz)
            v = 1.0 - w
            s = w
        else:
            s = _segment(cx, cy, cz, ax, ay, az)
            w = 1.0 - s
        place = EDGE + edge if 0.0 < s < 1.0 else VERTEX + (edge if s == 0.0 else (edge + 1) % 3)
    else:
        v, w, place = nearest_weights(ax, ay, az, bx, by, bz, cx, cy, cz)
    u = 1.0 - v - w
    x, y, z = u * ax + v * bx + w * cx, u * ay + v * by + w * cy, u * az + v * bz + w * cz
    return x * x + y * y + z * z, v, w, place


@kernel
def nearest_weights(ax: float, ay: float, az: float, bx: float, by: float, bz: float, cx: float, cy: float, cz: float):
    """Weights of b and c at the point of a triangle nearest to the origin, and its Voronoi region."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    d1, d2 = -(ux * ax + uy * ay + uz * az), -(vx * ax + vy * ay + vz * az)
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0, VERTEX
    d3, d4 = -(ux * bx + uy * by + uz * bz), -(vx * bx + vy * by + vz * bz)
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0, VERTEX + 1
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / (d1 - d3), 0.0, EDGE
    d5, d6 = -(ux * cx + uy * cy + uz * cz), -(vx * cx + vy * cy + vz * cz)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0, VERTEX + 2
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6), EDGE + 2
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - w, w, EDGE + 1
    scale = 1.0 / (va + vb + vc)
    return vb * scale, vc * scale, FACE


@kernel
def _disc(disc: Record, p0: float, p1: float, p2: float):
    """Squared distance [m²] of a point from a disc."""
    x, y, z = p0 - disc.centre[0], p1 - disc.centre[1], p2 - disc.centre[2]
    along = abs(x * disc.axis[0] + y * disc.axis[1] + z * disc.axis[2])
    across = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    along, across = max(along - disc.height, 0.0), max(across - disc.radius, 0.0)
    return along * along + across * across


@kernel
def _search(
    points: Record,
    cells: Record,
    discs: Record,
    p0: float,
    p1: float,
    p2: float,
    best: int,
    least: float,
    work: Record,
):
    """The nearest triangle by depth-first search, or `best` if none is nearer than its squared distance `least`."""
    count, leaves = len(cells), len(discs) // 4
    depth, node, start = 0, 1, best
    if _disc(discs[1], p0, p1, p2) > least:
        return best
    while True:
        if node < leaves:
            left, right = _disc(discs[2 * node], p0, p1, p2), _disc(discs[2 * node + 1], p0, p1, p2)
            node, near, far = (2 * node, left, right) if left <= right else (2 * node + 1, right, left)
            if near <= least:
                if far <= least:
                    work[depth].node, work[depth].away = node ^ 1, far
                    depth += 1
                continue
        else:
            leaf = node - leaves
            for t in range(leaf * count // leaves, (leaf + 1) * count // leaves):
                f, _, _, _ = _on_triangle(points, cells, t, p0, p1, p2)
                if f < least or (f == least and best != start and _before(cells, discs, t, best, p0, p1, p2)):
                    least, best = f, t
        node = 0
        while depth > 0 and node == 0:
            depth -= 1
            if work[depth].away <= least:
                node = work[depth].node
        if node == 0:
            return best


@kernel
def _before(cells: Record, discs: Record, t: int, other: int, p0: float, p1: float, p2: float):
    """Whether a depth-first search of the Morton tree, the nearer node first, visits a triangle before another one.

    Triangles at a vertex or an edge are equally near. This order determines which one counts.
    """
    count, leaves = len(cells), len(discs) // 4
    i, j = int(cells[t].rank), int(cells[other].rank)
    one, two = leaves + ((i + 1) * leaves - 1) // count, leaves + ((j + 1) * leaves - 1) // count
    if one == two:
        return i < j
    while one // 2 != two // 2:
        one, two = one // 2, two // 2
    low, high = 2 * leaves + min(one, two), 2 * leaves + max(one, two)
    return (one < two) == (_disc(discs[low], p0, p1, p2) <= _disc(discs[high], p0, p1, p2))


@kernel
def _descend(points: Record, cells: Record, star_at: Indices, star: Indices, p0: float, p1: float, p2: float, t: int):
    """Descend from triangle t over nearer and nearer neighbours. Returns the last one, and whether it is a minimum."""
    f, _, _, place = _on_triangle(points, cells, t, p0, p1, p2)
    for _ in range(64):
        if place == FACE:
            return t, True
        best, least, spot = t, f, place
        flat = cells[t].kind > 0
        for i in range(3):
            if not (flat or place == VERTEX + i or place == EDGE + i):
                continue
            a = cells[t].corners[i]
            if place == EDGE + i and not flat:
                s = cells[t].across[i]
                if s >= 0:
                    g, _, _, q = _on_triangle(points, cells, s, p0, p1, p2)
                    if g < least:
                        best, least, spot = s, g, q
                continue
            for k in range(star_at[a], star_at[a + 1]):
                g, _, _, q = _on_triangle(points, cells, star[k], p0, p1, p2)
                if g < least:
                    best, least, spot = star[k], g, q
        if best == t:
            return t, True
        t, f, place = best, least, spot
    return t, False
