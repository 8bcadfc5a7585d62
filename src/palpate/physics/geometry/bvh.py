"""Bounding-volume hierarchy over the triangles of a mesh, and the tables that the closest-point search reads.

Each node halves its triangles across their longest side (`search.halves`). The tree is complete and needs no links:
node k has the children 2k and 2k+1. The bounding volume is a disc: a flat cylinder across the mean normal of the
triangles. On a smooth surface its height falls with the square of its radius, whereas a box is as high as wide. A
search from 40 mm above a mesh of 10^6 vertices visits a few leaves instead of thousands.

A second tree of the same form has the triangles along a Morton curve (C. Lauterbach et al., Computer Graphics Forum 28
(2009) 375-384). It is not searched: of triangles that are equally near, as at a vertex, the first one counts that a
search of it would visit, so that a foot does not depend on how the first tree divides a mesh.
"""

from dataclasses import dataclass

import numpy as np

from palpate.compiler.fields import element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Array, Indices, Matrix, Record
from palpate.physics.geometry.search.corners import boxes_of, stars, weld
from palpate.physics.geometry.search.halves import halved_order
from palpate.physics.geometry.search.morton import morton_order

LEAF = 4
PART, WHOLE = 64, 2048  # A node of at least WHOLE leaves is bounded by the discs of its parts of PART leaves
FLAT = 1e-12  # [1] A triangle is degenerate if its area over its longest edge squared is smaller

POINT = {"position": (3,), "normal": (3,)}
"""A vertex: position [m], outward unit normal [1]."""
INDEX, THREE = np.dtype("<i4"), np.dtype(("<i4", 3))
CELL = {"corners": THREE, "across": THREE, "kind": INDEX, "origin": INDEX, "rank": INDEX}
"""A triangle: its corners; its neighbours across its edges (corner i to i+1; -1 at a border); 0, or 1 + its longest
edge if it is degenerate; its index in the mesh; its place on the Morton curve."""
DISC = {"centre": (3,), "axis": (3,), "radius": (), "height": ()}
"""The bound of a node of the tree: a cylinder with this centre [m], axis [1], radius and half height [m]."""
MOMENTS = {"corners": (3,), "normals": (3,), "count": ()}
"""Sums over the triangles below a node: corners [m], normals [m²], number of corners."""
POINTS, CELLS, DISCS = element_type(POINT), element_type(CELL), element_type(DISC)


@dataclass(frozen=True, eq=False)
class MeshTables:
    """Tables of a mesh for the search."""

    points: np.ndarray  # (V) `POINT`; equal positions are merged
    cells: np.ndarray  # (T) `CELL` of each triangle in the order of the tree
    discs: np.ndarray  # (2N) `DISC` of each node, node 0 is unused, node 1 the root; then those of the Morton tree
    star_at: np.ndarray  # (V+1) index in `star` where the list of each vertex begins
    star: np.ndarray  # (3T) the triangles round each vertex

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """In the order in which the kernels take them."""
        return self.points, self.cells, self.discs, self.star_at, self.star


def mesh_tables(vertices: np.ndarray, triangles: np.ndarray, facing: np.ndarray | None = None) -> MeshTables:
    """Tables of a mesh, vertices [m] (V,3), triangles (T,3) and known normals (V,3), 0: none. Duplicates and triangles
    that coincide with an edge of another one are removed; other degenerate triangles remain as segments without a
    normal. Unused vertices are allowed. ValueError: no triangle, an index out of range, a vertex that is not finite."""
    vertices = np.ascontiguousarray(vertices, dtype=float)
    triangles = np.ascontiguousarray(triangles, dtype=np.int32)
    if not len(triangles):
        raise ValueError("the mesh has no triangles")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ValueError(f"a triangle refers to vertex {triangles.max()}, the mesh has {len(vertices)}")
    if not np.isfinite(vertices[triangles]).all():
        raise ValueError("a vertex of a triangle is not finite")
    triangles = weld(vertices)[triangles]
    keep = np.flatnonzero(~_superfluous(triangles, *stars(triangles, len(vertices))))
    triangles = triangles[keep]
    low, high = boxes_of(vertices, triangles)
    order = morton_order((low + high) / 2)
    triangles = np.ascontiguousarray(triangles[order])
    star_at, star = stars(triangles, len(vertices))
    cells = np.zeros(len(triangles), CELLS)
    cells["corners"] = triangles
    cells["origin"] = keep[order]
    points = np.zeros(len(vertices), POINTS)
    points["position"] = vertices
    _topology(points, cells, star_at, star)
    if facing is not None:
        points["normal"] = np.where((facing != 0.0).any(axis=1, keepdims=True), facing, points["normal"])
    leaves = 1 << (-(-len(triangles) // LEAF) - 1).bit_length()
    discs = np.zeros(4 * leaves, DISCS)
    _discs(vertices, triangles, leaves, np.zeros(2 * leaves, element_type(MOMENTS)), discs[2 * leaves :])
    halved = halved_order((low + high)[order], leaves)
    triangles, cells, star = _renumbered(triangles, cells, star, halved)
    _discs(vertices, triangles, leaves, np.zeros(2 * leaves, element_type(MOMENTS)), discs[: 2 * leaves])
    return MeshTables(points, cells, discs, star_at, star)


def _renumbered(
    triangles: np.ndarray, cells: np.ndarray, star: np.ndarray, order: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (T,3), their cells and the lists round vertices, whose order stays, with the triangles in an order."""
    number = np.empty(len(order), np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    cells = cells[order]
    cells["rank"] = order
    cells["across"] = np.where(cells["across"] >= 0, number[cells["across"]], -1)
    return triangles[order], cells, number[star]


@kernel
def is_segment(corners: Indices):
    """Whether two corners (3) of a triangle are equal."""
    a, b, c = corners[0], corners[1], corners[2]
    return a == b or b == c or c == a


@kernel
def _superfluous(triangles: Indices, at: Indices, star: Indices):
    """Whether each triangle (T,) repeats an earlier one with the same orientation, or is an edge or corner of one."""
    superfluous = np.zeros(len(triangles), dtype=np.bool_)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        flat = is_segment(triangles[t])
        other = b if b != a else c
        for k in range(at[a], at[a + 1]):
            s = star[k]
            x, y, z = triangles[s, 0], triangles[s, 1], triangles[s, 2]
            if flat:
                superfluous[t] = superfluous[t] or (
                    not is_segment(triangles[s]) and (x == other or y == other or z == other)
                )
            elif s < t and (
                (x == a and y == b and z == c) or (x == b and y == c and z == a) or (x == c and y == a and z == b)
            ):
                superfluous[t] = True
    return superfluous


@kernel
def _discs(vertices: Matrix, triangles: Indices, leaves: int, sums: Record, discs: Record):
    """Bounding discs of all nodes, with their `MOMENTS`.

    Nodes with less than `WHOLE` leaves enclose their vertices; larger ones the discs of their descendants with `PART`
    leaves, at 1 % of the cost.
    """
    count = len(triangles)
    # moments from the leaves upwards; the children of a node are 2 node and 2 node + 1
    for node in range(2 * leaves - 1, 0, -1):
        if node >= leaves:
            for t in range((node - leaves) * count // leaves, (node - leaves + 1) * count // leaves):
                _add_triangle(vertices, triangles[t], sums[node])
        else:
            _add_moments(sums[2 * node], sums[2 * node + 1], sums[node])
        _start_disc(sums[node], discs[node])
        # extent along the axis and across it
        below = 1
        while node * below < leaves:
            below *= 2
        low, high, wide = np.inf, -np.inf, 0.0
        if below >= WHOLE:
            step = below // PART
            for part in range(node * step, node * step + step):
                if sums[part].count == 0.0:
                    continue
                along, across, cosine = _relative_disc(discs[part], discs[node])
                sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
                reach = discs[part].radius * sine + discs[part].height * cosine
                low, high = min(low, along - reach), max(high, along + reach)
                wide = max(wide, across + discs[part].radius + discs[part].height * sine)
        else:
            first = (node * below - leaves) * count // leaves
            last = (node * below - leaves + below) * count // leaves
            for t in range(first, last):
                for k in range(3):
                    along, across = _corner(vertices[triangles[t, k]], discs[node])
                    low, high, wide = min(low, along), max(high, along), max(wide, across)
        if high < low:
            low = high = 0.0
        # the centre moves to the middle of the extent along the axis
        middle = 0.5 * (low + high)
        size, disc = high - low + wide, discs[node]
        for i in range(3):
            disc.centre[i] += middle * disc.axis[i]
            size += abs(disc.centre[i])
        # a margin for rounding
        disc.radius = wide + 1e-9 * size
        disc.height = 0.5 * (high - low) + 1e-12 * size


@kernel
def _add_moments(left: Record, right: Record, sums: Record):
    for i in range(3):
        sums.corners[i] = left.corners[i] + right.corners[i]
        sums.normals[i] = left.normals[i] + right.normals[i]
    sums.count = left.count + right.count


@kernel
def _add_triangle(vertices: Matrix, triangle: Indices, sums: Record):
    p, q, r = vertices[triangle[0]], vertices[triangle[1]], vertices[triangle[2]]
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    for i in range(3):
        sums.corners[i] += p[i] + q[i] + r[i]
    sums.normals[0] += uy * vz - uz * vy
    sums.normals[1] += uz * vx - ux * vz
    sums.normals[2] += ux * vy - uy * vx
    sums.count += 3.0


@kernel
def _start_disc(sums: Record, disc: Record):
    x, y, z = vector(sums.normals)
    length = np.sqrt(x * x + y * y + z * z)
    for i in range(3):
        disc.centre[i] = sums.corners[i] / max(sums.count, 1.0)
        disc.axis[i] = sums.normals[i] / length if length > 0.0 else (1.0 if i == 2 else 0.0)


@kernel
def _corner(x: Array, disc: Record):
    """Coordinate of a point along the axis of a disc, and its distance from the axis."""
    a, b, c = x[0] - disc.centre[0], x[1] - disc.centre[1], x[2] - disc.centre[2]
    along = a * disc.axis[0] + b * disc.axis[1] + c * disc.axis[2]
    return along, np.sqrt(max(a * a + b * b + c * c - along * along, 0.0))


@kernel
def _relative_disc(part: Record, disc: Record):
    """Centre of a disc relative to another: along its axis, distance from it, and the cosine between both axes."""
    along, across = _corner(part.centre, disc)
    a, b = part.axis, disc.axis
    return along, across, abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel
def _topology(points: Record, cells: Record, star_at: Indices, star: Indices):
    """Fill in the neighbours, degenerate triangles and angle-weighted normals of the vertices."""
    side = np.empty((3, 3))
    square = np.empty(3)
    for t in range(len(cells)):
        cell = cells[t]
        for i in range(3):
            a, b = cell.corners[i], cell.corners[(i + 1) % 3]
            square[i] = 0.0
            for c in range(3):
                side[i, c] = points[b].position[c] - points[a].position[c]
                square[i] += side[i, c] * side[i, c]
            cell.across[i] = _neighbour(cells, star_at, star, t, a, b)
        x = side[0, 1] * side[1, 2] - side[0, 2] * side[1, 1]
        y = side[0, 2] * side[1, 0] - side[0, 0] * side[1, 2]
        z = side[0, 0] * side[1, 1] - side[0, 1] * side[1, 0]
        length = np.sqrt(x * x + y * y + z * z)
        # a degenerate triangle has no normal; its kind names its longest side
        longest = 0 if square[0] >= max(square[1], square[2]) else (1 if square[1] >= square[2] else 2)
        if 0.5 * length <= FLAT * square[longest]:
            cell.kind = 1 + longest
            continue
        cell.kind = 0
        # add the normal to the corners, weighted by the angle there
        for i in range(3):
            j = (i + 2) % 3
            cosine = -(side[i, 0] * side[j, 0] + side[i, 1] * side[j, 1] + side[i, 2] * side[j, 2])
            weight = np.arctan2(length, cosine) / length
            normal = points[cell.corners[i]].normal
            normal[0] += weight * x
            normal[1] += weight * y
            normal[2] += weight * z
    for v in range(len(points)):
        normal = points[v].normal
        length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        if length > 1e-12:
            for c in range(3):
                normal[c] /= length


@kernel
def _neighbour(cells: Record, star_at: Indices, star: Indices, t: int, a: int, b: int):
    """The triangle across the edge from corner a to b of triangle t, preferably with the same orientation; or -1."""
    neighbour = -1
    for k in range(star_at[a], star_at[a + 1]):
        s = star[k]
        if s == t or is_segment(cells[s].corners):
            continue
        for j in range(3):
            x, y = cells[s].corners[j], cells[s].corners[(j + 1) % 3]
            if x == b and y == a:
                return s
            if x == a and y == b and neighbour < 0:
                neighbour = s
    return neighbour
