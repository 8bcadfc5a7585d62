"""Which triangles of a surface a ball can touch.

A ball of radius r touches the surface at x, with the outward normal n, if no other part of the body is within r of its
centre x + r n. The test at the middle of a triangle is enough where edges are short; larger triangles are divided.
"""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.compiler.fields import blank_record, element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Array, Indices, Matrix, Record
from palpate.physics.geometry.bvh import morton
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import STACK, MeshClosestPoint, _disc, _on_triangle
from palpate.physics.geometry.pseudonormal import signed_distance
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.geometry.search.foot import FOOT

SLACK = 20e-6
"""[m] By which another part may be inside the ball: facets of 1.6 mm on a concave surface just wider than the ball are
16 um nearer than the surface that they approximate."""
TOGETHER = 16  # balls that share a search
FEW = 512  # nodes of a search of which all vertices are tested first
LEVELS = 2  # of the tree above the leaves that each ball searches alone
BALLS = element_type({"centre": (3,), "middle": (3,), "normal": (3,), "hidden": int})
"""A ball that would touch the middle [m] of a triangle with this normal [1]: its centre [m], and 1 if it cannot."""
LEVEL = 1e-12  # [m] over the tangent plane up to which a part is below it, for rounding: walls may be 5 um apart
SHORT = 1 / 3  # [1] of the radius: longest edge of a triangle whose middle represents it


def divide_long_edges(mesh: Mesh, longest: float) -> tuple[Mesh, np.ndarray]:
    """The same flat triangles with edges of at most `longest` [m], and for each the triangle of `mesh` (T,)."""
    points, triangles, origin = mesh.vertices, mesh.triangles.astype(np.int64), np.arange(len(mesh.triangles))
    while True:
        ends, of, _ = edges_of(triangles, len(points))
        long = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1) > longest
        if not long.any():
            return Mesh(points, np.ascontiguousarray(triangles, np.int32)), origin
        number = np.full(len(ends), -1)
        number[long] = len(points) + np.arange(long.sum())
        points = np.concatenate([points, 0.5 * (points[ends[long, 0]] + points[ends[long, 1]])])
        triangles, part = divide_triangles(triangles, number[of])
        origin = origin[part]


def untouchable(mesh: Mesh, closest: MeshClosestPoint, radius: float) -> np.ndarray:
    """Whether no ball of the radius [m] touches the middle of each triangle (T,) of a mesh with edges of at most
    `SHORT` of the radius; `closest` finds the nearest points of the whole body."""
    length = np.linalg.norm(mesh.face_vectors, axis=1)
    facing = np.flatnonzero(length > 0.0)
    hidden = np.zeros(len(mesh.triangles), bool)
    middle = einsum("tkc,k->tc", mesh.vertices[mesh.triangles[facing]], np.full(3, 1.0 / 3.0))
    hidden[facing] = hides(closest, middle, mesh.face_vectors[facing] / length[facing, None], radius)
    return hidden


def hides(closest: MeshClosestPoint, points: np.ndarray, normals: np.ndarray, radius: float) -> np.ndarray:
    """Whether a part of a body is inside the ball of the radius [m] that touches it at each point [m] (n,3) with this
    unit normal (n,3): (n,)."""
    hidden = np.zeros(len(points), bool)
    if not len(points):
        return hidden
    low, size = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-300)
    order = np.argsort(morton(points, low, size), kind="stable")
    balls = np.zeros(len(points), BALLS)
    balls["middle"], balls["normal"] = points[order], normals[order]
    balls["centre"] = balls["middle"] + radius * balls["normal"]
    tables = closest.tables
    count, nodes = len(tables.points), np.empty(len(tables.discs), np.int64)
    margin = np.zeros(count)
    _margins(tables.points, tables.cells, margin)
    closed = closest.mesh.closed  # a sheet has no inside
    _fill(*tables.arrays, balls, radius, closed, nodes, np.empty(STACK, np.int64), blank_record(FOOT),
          np.full(count, -1), np.empty((4, count)), np.empty((2, count + 1), np.int64),
          np.full(len(tables.cells), -1), margin)  # fmt: skip
    hidden[order] = balls["hidden"] > 0
    return hidden


@kernel
def _fill(
    points: Record, cells: Record, discs: Record, star_at: Indices, star: Indices, balls: Record, radius: float,
    closed: bool, nodes: Indices, work: Indices, foot: Record, seen: Indices, around: Matrix, some: Indices,
    tested: Indices, margin: Array,
):  # fmt: skip
    """Fill in whether each ball is hidden. First the triangle is tested that hid the ball before. Neighbouring balls
    share the search down to `LEVELS` above the leaves, and the vertices below. On a convex surface none of these is
    above their tangent planes. Elsewhere, the triangles at those are tested that are near the ball (`_near_ball`).

    seen (V), around (4,V), some (2,V+1), tested (T)  workspaces, seen and tested of -1;  margin (V)  of `_margins`
    """
    last, enough = -1, (radius - SLACK) ** 2
    for begin in range(0, len(balls), TOGETHER):
        group, size, close, few = balls[begin : begin + TOGETHER], -1, 0, False
        for number in range(len(group)):
            ball = group[number]
            if last >= 0 and _above(points, cells, last, ball, radius):
                square, _, _, _ = _on_triangle(points, cells, last, ball.centre[0], ball.centre[1], ball.centre[2])
                if square < enough:
                    ball.hidden = 1
                    continue
            if size < 0:
                size = _nodes_near(discs, group, radius, nodes, work)
                few = size <= FEW
                if few:
                    close = _gather(points, cells, len(discs) // 2, nodes[:size], begin, seen, margin, around, some)
            if few and not _any_above(around, close, ball, radius):
                last = -1
                continue
            if few:
                count = _near_ball(around, close, ball, radius, some)
                near = some[1, :count]
                best, least = _nearest_at(points, cells, star_at, star, ball, radius, near, begin + number, tested)
            else:
                best, least = _in_front(points, cells, discs, ball, radius, nodes[:size], work)
            last = -1
            if best >= 0:
                p0, p1, p2 = vector(ball.centre)
                hidden = least < enough
                last = best if hidden else -1
                if closed and not hidden:
                    _, v, w, place = _on_triangle(points, cells, best, p0, p1, p2)
                    away = signed_distance(points, cells, star_at, star, best, v, w, place, p0, p1, p2, foot)
                    hidden = away < 0.0
                ball.hidden = 1 if hidden else 0


@kernel
def _nodes_near(discs: Record, balls: Record, radius: float, found: Indices, work: Indices):
    """Fill in the nodes `LEVELS` above the leaves of the tree that may have a part in front of a ball; returns their
    number.

    A node is left out if it is farther than the radius from all centres, or outside all balls: x is in a ball through
    m with the normal n if |x - m|² < 2 r (x - m).n. All m are within `wide` of their mean and at most `low` below it
    along the mean normal, and |n - mean| <= `spread`, so |x - m| >= |x - mean m| - wide, and (x - m).n is at most
    (x - mean m).(mean n) + low + (|x - mean m| + wide) spread.
    """
    count = len(balls)
    m0 = m1 = m2 = n0 = n1 = n2 = 0.0
    for ball in balls:
        m0, m1, m2 = m0 + ball.middle[0] / count, m1 + ball.middle[1] / count, m2 + ball.middle[2] / count
        n0, n1, n2 = n0 + ball.normal[0] / count, n1 + ball.normal[1] / count, n2 + ball.normal[2] / count
    wide = low = spread = reach = 0.0
    for ball in balls:
        x, y, z = ball.middle[0] - m0, ball.middle[1] - m1, ball.middle[2] - m2
        u, v, w = ball.normal[0] - n0, ball.normal[1] - n1, ball.normal[2] - n2
        wide, low = max(wide, np.sqrt(x * x + y * y + z * z)), max(low, -(x * n0 + y * n1 + z * n2))
        spread = max(spread, np.sqrt(u * u + v * v + w * w))
        x, y, z = x + radius * u, y + radius * v, z + radius * w
        reach = max(reach, np.sqrt(x * x + y * y + z * z))
    p0, p1, p2 = m0 + radius * n0, m1 + radius * n1, m2 + radius * n2
    most, lowest, size = (radius + reach) ** 2, max(len(discs) >> (1 + LEVELS), 1), 0
    depth = work[0] = 1
    while depth > 0:
        depth -= 1
        node = work[depth]
        disc = discs[node]
        x, y, z = disc.centre[0] - m0, disc.centre[1] - m1, disc.centre[2] - m2
        length, size_of = np.sqrt(x * x + y * y + z * z), disc.radius + disc.height + wide
        up = x * n0 + y * n1 + z * n2 + _extent(disc, n0, n1, n2) + low + (length + size_of) * spread
        least = max(length - size_of, 0.0)
        if 2.0 * radius * (up - LEVEL) <= least * least or _disc(disc, p0, p1, p2) >= most:
            continue
        if node >= lowest:
            found[size] = node
            size += 1
        else:
            work[depth], work[depth + 1] = 2 * node, 2 * node + 1
            depth += 2
    return size


@kernel
def _margins(points: Record, cells: Record, margin: Array):
    """Fill in a third of the square of the longest edge [m²] of the triangles round each vertex (V): on a triangle the
    squared distance from a point is nowhere smaller than the least one of its corners by more than this."""
    for t in range(len(cells)):
        for i in range(3):
            a, b, square = cells[t].corners[i], cells[t].corners[(i + 1) % 3], 0.0
            for k in range(3):
                square += (points[a].position[k] - points[b].position[k]) ** 2 / 3.0
            for k in range(3):
                c = cells[t].corners[k]
                margin[c] = max(margin[c], square)


@kernel
def _gather(
    points: Record, cells: Record, leaves: int, near: Indices, number: int, seen: Indices, margin: Array,
    around: Matrix, some: Indices,
):  # fmt: skip
    """Fill in the positions [m] and margins [m²] (4,n) of the vertices (n) of all triangles below these nodes, each
    once; returns n. Those already found have the number of this search in `seen` (V)."""
    size, count = 0, len(cells)
    for node in near:
        below = 1
        while node * below < leaves:
            below *= 2
        first = node * below - leaves
        for t in range(first * count // leaves, (first + below) * count // leaves):
            for k in range(3):
                v = cells[t].corners[k]
                if seen[v] != number:
                    seen[v] = number
                    for i in range(3):
                        around[i, size] = points[v].position[i]
                    around[3, size], some[0, size] = margin[v], v
                    size += 1
    return size


@kernel
def _any_above(around: Matrix, count: int, ball: Record, radius: float):
    """Whether one of the first vertices [m] (4,n) is above the tangent plane of a ball (`_above`)."""
    p0, p1, p2 = vector(ball.centre)
    n0, n1, n2 = vector(ball.normal)
    x, y, z, _ = around
    found, limit = 0, radius - LEVEL
    for k in range(count):
        found += 1 if (p0 - x[k]) * n0 + (p1 - y[k]) * n1 + (p2 - z[k]) * n2 < limit else 0
    return found > 0


@kernel
def _near_ball(around: Matrix, count: int, ball: Record, radius: float, some: Indices):
    """Fill in those of the vertices some[0,:n], at places and with margins (4,n), of which a triangle may reach into
    the ball, in some[1]; returns their number."""
    p0, p1, p2 = vector(ball.centre)
    x, y, z, margin = around
    size, most = 0, radius * radius
    for k in range(count):
        u, v, w = x[k] - p0, y[k] - p1, z[k] - p2
        some[1, size] = some[0, k]
        size += 1 if u * u + v * v + w * w - margin[k] < most else 0
    return size


@kernel
def _nearest_at(
    points: Record, cells: Record, star_at: Indices, star: Indices, ball: Record, radius: float, near: Indices,
    number: int, tested: Indices,
):  # fmt: skip
    """`_in_front` of the triangles at these vertices. Those already tested have the number of the ball in `tested`
    (T)."""
    p0, p1, p2 = vector(ball.centre)
    best, least, enough = -1, radius * radius, (radius - SLACK) ** 2
    for v in near:
        for k in range(star_at[v], star_at[v + 1]):
            t = star[k]
            if tested[t] == number:
                continue
            tested[t] = number
            if _above(points, cells, t, ball, radius):
                square, _, _, _ = _on_triangle(points, cells, t, p0, p1, p2)
                if square < least:
                    best, least = t, square
                if least < enough:
                    return best, least
    return best, least


@kernel
def _in_front(points: Record, cells: Record, discs: Record, ball: Record, radius: float, near: Indices, work: Indices):
    """A triangle in a ball, above the tangent plane on which it lies, and its squared distance [m²] from the centre;
    -1: none. The nearest one, or any that is nearer than `SLACK` allows. near  (n,) nodes of the tree to be searched.

    All that is below the plane is outside the ball: on a smooth convex surface that is all of the neighbourhood.
    """
    p0, p1, p2 = vector(ball.centre)
    n0, n1, n2 = vector(ball.normal)
    count, leaves = len(cells), len(discs) // 2
    best, least, enough = -1, radius * radius, (radius - SLACK) ** 2
    for top in near:
        work[0] = top
        depth = 1
        while depth > 0:
            depth -= 1
            node = work[depth]
            disc = discs[node]
            along = (p0 - disc.centre[0]) * n0 + (p1 - disc.centre[1]) * n1 + (p2 - disc.centre[2]) * n2
            if along - _extent(disc, n0, n1, n2) >= radius - LEVEL or _disc(disc, p0, p1, p2) >= least:
                continue
            if node < leaves:
                work[depth], work[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
                continue
            for t in range((node - leaves) * count // leaves, (node - leaves + 1) * count // leaves):
                if _above(points, cells, t, ball, radius):
                    square, _, _, _ = _on_triangle(points, cells, t, p0, p1, p2)
                    if square < least:
                        best, least = t, square
                    if least < enough:
                        return best, least
    return best, least


@kernel
def _above(points: Record, cells: Record, t: int, ball: Record, radius: float):
    """Whether a part of a triangle is above the tangent plane of a ball."""
    low = np.inf
    for i in range(3):
        at = points[cells[t].corners[i]].position
        x, y, z = ball.centre[0] - at[0], ball.centre[1] - at[1], ball.centre[2] - at[2]
        low = min(low, x * ball.normal[0] + y * ball.normal[1] + z * ball.normal[2])
    return low < radius - LEVEL


@kernel
def _extent(disc: Record, n0: float, n1: float, n2: float):
    """How far a disc extends from its centre in a direction n [m], whose length may be below 1."""
    cosine = abs(disc.axis[0] * n0 + disc.axis[1] * n1 + disc.axis[2] * n2)
    square = n0 * n0 + n1 * n1 + n2 * n2
    return disc.radius * np.sqrt(max(square - cosine * cosine, 0.0)) + disc.height * cosine
