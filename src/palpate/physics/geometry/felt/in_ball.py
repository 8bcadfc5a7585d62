"""Kernels that search for parts of a body in balls that touch it: for nodes of its tree that may reach into one of
several balls, for the vertices below these nodes, and for the triangles at vertices near a ball."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Array, Indices, Matrix, Record
from palpate.physics.geometry.mesh_closest import _disc, _on_triangle

SLACK = 20e-6
"""[m] By which another part may be inside the ball: facets of 1.6 mm on a concave surface just wider than the ball are
16 um nearer than the surface that they approximate."""
LEVELS = 2  # of the tree above the leaves that each ball searches alone
LEVEL = 1e-12  # [m] over the tangent plane up to which a part is below it, for rounding: walls may be 5 um apart


@kernel
def nodes_near(discs: Record, balls: Record, radius: float, found: Indices, work: Indices):
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
    most, lowest, size = (radius + reach) ** 2, max(len(discs) >> (2 + LEVELS), 1), 0
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
def fill_margins(points: Record, cells: Record, margin: Array):
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
def gather_vertices(
    points: Record, cells: Record, leaves: int, near: Indices, number: int, seen: Indices, margin: Array,
    around: Matrix, some: Indices,
):  # fmt: skip
    """Fill in the positions [m] and margins [m²] (4,n) of the vertices (n) of all triangles below these nodes, each
    once; returns n. Those already found have the number of this search in `seen` (V)."""
    (x, y, z, spare), (every, _) = around, some
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
                    x[size], y[size], z[size] = vector(points[v].position)
                    spare[size], every[size] = margin[v], v
                    size += 1
    return size


@kernel
def any_above(around: Matrix, count: int, ball: Record, radius: float):
    """Whether one of the first vertices [m] (4,n) is above the tangent plane of a ball (`is_above`)."""
    p0, p1, p2 = vector(ball.centre)
    n0, n1, n2 = vector(ball.normal)
    x, y, z, _ = around
    found, limit = 0, radius - LEVEL
    for k in range(count):
        found += 1 if (p0 - x[k]) * n0 + (p1 - y[k]) * n1 + (p2 - z[k]) * n2 < limit else 0
    return found > 0


@kernel
def vertices_near(around: Matrix, count: int, ball: Record, radius: float, some: Indices):
    """Fill in those of the vertices some[0,:n], at places and with margins (4,n), of which a triangle may reach into
    the ball, in some[1]; returns their number."""
    p0, p1, p2 = vector(ball.centre)
    (x, y, z, margin), (every, near) = around, some
    size, most = 0, radius * radius
    for k in range(count):
        u, v, w = x[k] - p0, y[k] - p1, z[k] - p2
        near[size] = every[k]
        size += 1 if u * u + v * v + w * w - margin[k] < most else 0
    return size


@kernel
def nearest_at(
    points: Record, cells: Record, star_at: Indices, star: Indices, ball: Record, radius: float, enough: float,
    near: Indices, number: int, tested: Indices,
):  # fmt: skip
    """`nearest_below` of the triangles at these vertices. Those already tested have the number of the ball in `tested`
    (T)."""
    best, least = -1, radius * radius
    for v in near:
        for k in range(star_at[v], star_at[v + 1]):
            t = star[k]
            if tested[t] == number:
                continue
            tested[t] = number
            best, least = _nearer(points, cells, t, ball, radius, best, least)
            if least < enough:
                return best, least
    return best, least


@kernel
def _nearer(points: Record, cells: Record, t: int, ball: Record, radius: float, best: int, least: float):
    """The triangle in a ball that is nearest to its centre so far, and its squared distance [m²], after this one."""
    if is_above(points, cells, t, ball, radius):
        square, _, _, _ = _on_triangle(points, cells, t, ball.centre[0], ball.centre[1], ball.centre[2])
        if square < least:
            return t, square
    return best, least


@kernel
def nearest_below(
    points: Record, cells: Record, discs: Record, ball: Record, radius: float, enough: float, near: Indices,
    work: Indices,
):  # fmt: skip
    """A triangle in a ball, above the tangent plane on which it lies, and its squared distance [m²] from the centre;
    -1: none. The nearest one, or any whose squared distance is below `enough`.
    near  (n,) nodes of the tree to be searched.

    All that is below the plane is outside the ball: on a smooth convex surface that is all of the neighbourhood.
    """
    p0, p1, p2 = vector(ball.centre)
    n0, n1, n2 = vector(ball.normal)
    count, leaves = len(cells), len(discs) // 4
    best, least = -1, radius * radius
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
                best, least = _nearer(points, cells, t, ball, radius, best, least)
                if least < enough:
                    return best, least
    return best, least


@kernel
def is_above(points: Record, cells: Record, t: int, ball: Record, radius: float):
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
