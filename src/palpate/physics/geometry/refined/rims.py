"""Rims at which the surface bends by less than 40 degrees, such as those of a flat wall that meets it at a small angle.

On a coarse smooth mesh all edges bend, so that a bend alone does not show a rim. Whether the direction jumps does. The
mesh is cut by the plane across an edge, through two points of it. To each side of the edge the section is a polygon,
whose sides of similar angle (within `SAME` of the bend b) are joined. A line is fitted to the angles at the middles of
these sides, over the length D, three times that of the longest side of the shorter polygon. On a smooth surface the
lines of both sides meet at the edge, even if it is coarse: on a circle of equal facets exactly. At a rim their
difference is b. So the direction jumps at an edge if the difference is within `JUMP` of b, and within D either no angle
differs by more than `EVEN` b from that at the edge, or one side is flat and `WIDE` times as wide as a facet of the
other, whose angles differ by at most `ROUND` b.

On scattered, coarse or stepped meshes it jumps at single edges by chance, up to five in a row on 60 organs. A rim is a
chain of at least `CHAIN` edges at which it jumps, or that bend by more than 40 degrees (`STEEP`: 36, if it jumps). A
long edge between two flat sides, of which a boolean has removed the vertices, counts for as many as have its length.
Edges of triangles that are too thin for a normal do not interrupt it. Edges between those of a chain belong to it.
"""

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum, row_times
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.refined.edge_list import edges_of
from palpate.physics.geometry.refined.edges import CREASE, directions, known_normals, length_between, unit

LEAST = 0.99  # [1] cosine of 8 degrees
STEEP = 0.809  # [1] cosine of 36 degrees, from which a jump continues a chain of edges that bend by more than 40
STARTS = (0.3, 0.7)  # [1] along the edge; a section through its middle would pass through vertices of regular meshes
SAME = 0.1  # [1] difference of angles over the bend
JUMP = (0.7, 1.4)  # [1] over the bend
EVEN, FLAT, ROUND = 0.6, 0.05, 0.8  # [1] change of the angle within D over the bend
WIDE = 3.0  # [1]
CHAIN = 6  # edges
COUNTS = 1.6e-3  # [m] length of a long edge that counts as one, if the median of all edges is longer
STRAIGHT = 0.5  # [1] cosine of 60 degrees, by which a chain may turn from edge to edge
ENOUGH = 2.2  # [1] length of a polygon over that of its longest side
MOST, STEPS = 12, 300  # sides of a polygon, and triangles through which it passes
RIDGE = 0.01  # [1] regularization of the slope of a line, of a few short sides
LOWEST = 0.3  # [1] sine between the normal of a triangle and the edge below which its angle is not known

SECTION = np.dtype([("point", "<f8", 3), ("along", "<f8", 3), ("out", "<f8", 3), ("up", "<f8", 3), ("same", "<f8")])
"""A section: a point of the edge [m], the unit vectors along it, away from it, and up, and `SAME` times the bend."""
SIDE = np.dtype([("lengths", "<f8", MOST), ("angles", "<f8", MOST), ("size", "<i8")])
"""The polygon to one side of an edge: lengths [m] and angles [rad] of its sides, and how many there are. The angle a is
2 tan(a/2), within 4 % up to 40 degrees."""
BEND = np.dtype([(name, "<f8") for name in ("jump", "change", "least", "wide")])
"""The difference of the lines [rad]; the larger and the smaller of the largest changes [rad] to each side; the quotient
[1] of the longest sides."""


def find_rims(mesh: Mesh) -> np.ndarray:
    """Ends (K,2), lower first, in ascending order, of the edges of rims that bend by 8 to 40 degrees, of chains of
    edges that bend by more, and of the edges that connect them."""
    triangles = mesh.triangles.astype(np.int64)
    ends, of, two = edges_of(triangles, len(mesh.vertices))
    facing, known = directions(mesh.vertices, triangles), known_normals(mesh.vertices, triangles, two)
    half, known = known[two].any(axis=1), known[two].all(axis=1)
    cosine = einsum("ij,ij->i", facing[two[:, 0]], facing[two[:, 1]])
    whole = np.bincount(of.ravel(), minlength=len(ends)) == 2
    shallow = np.flatnonzero(whole & known & (cosine >= CREASE) & (cosine < LEAST))
    sharp, bends = whole & known & (cosine < CREASE), np.zeros((len(shallow), len(STARTS)), BEND)
    bend = 2.0 * np.sqrt((1.0 - cosine[shallow]) / (1.0 + cosine[shallow]))
    _measure(mesh.vertices, triangles, ends, of, two, facing, sharp | ~whole, shallow, bend, bends,
             np.zeros(1, SECTION), np.zeros(2, SIDE))  # fmt: skip
    bends = bends[np.arange(len(bends)), bends["jump"].argmin(axis=1)]
    low, high = (share * bend for share in JUMP)
    length = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    both_flat = bends["change"] < FLAT * bend
    count = np.ones(len(ends))
    count[shallow[both_flat]] = np.maximum(length[shallow[both_flat]] / min(np.median(length), COUNTS), 1.0)
    even = bends["change"] < EVEN * bend
    flat = (bends["least"] < FLAT * bend) & (bends["wide"] > WIDE) & (bends["change"] < ROUND * bend)
    jumps = shallow[(bends["jump"] > low) & (bends["jump"] < high) & (even | flat)]
    gaps = np.flatnonzero(whole & half & ~known)
    steep = np.concatenate([np.flatnonzero(sharp), jumps[cosine[jumps] < STEEP]])
    rim, steep = (_chains(mesh.vertices, ends, some, gaps, count) for some in (jumps, steep))
    # edges between them that do not jump
    at_rim, at_any = np.zeros((2, len(mesh.vertices)), bool)
    at_rim[ends[rim]] = at_any[ends[rim]] = at_any[ends[steep]] = True
    more = np.concatenate([shallow, gaps])
    more = more[at_rim[ends[more]].any(axis=1) & at_any[ends[more]].all(axis=1)]
    return np.asarray(ends[np.unique(np.concatenate([rim, more, steep]))])


def _chains(points: np.ndarray, ends: np.ndarray, jumps: np.ndarray, gaps: np.ndarray, count: np.ndarray) -> np.ndarray:
    """The edges that are part of a chain with at least `CHAIN` of `jumps` and others of `gaps`: indices of `ends` (E,2)
    of edges between points [m] (V,3). `count` (E): for how many edges each counts."""
    if count[jumps].sum() < CHAIN:
        return np.zeros(0, np.int64)
    some = np.concatenate([jumps, gaps])
    along = unit(points[ends[some, 1]] - points[ends[some, 0]])
    # each edge at both of its ends, by vertex, and all pairs that share one
    vertex, edge, out = ends[some].T.ravel(), np.tile(np.arange(len(some)), 2), np.concatenate([along, -along])
    order = np.argsort(vertex, kind="stable")
    vertex, edge, out = vertex[order], edge[order], out[order]
    first = second = np.zeros(0, np.int64)
    for apart in range(1, len(vertex)):
        same = np.flatnonzero(vertex[apart:] == vertex[:-apart])
        if not len(same):
            break
        same = same[einsum("ij,ij->i", out[same], out[same + apart]) < -STRAIGHT]
        first, second = np.concatenate([first, edge[same]]), np.concatenate([second, edge[same + apart]])
    graph = scipy.sparse.coo_array((np.ones(len(first), bool), (first, second)), shape=(len(some), len(some)))
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    long = np.bincount(label[: len(jumps)], count[jumps], minlength=label.max() + 1) >= CHAIN
    return np.sort(some[long[label]])


@ieee_kernel
def _measure(
    points: Matrix, triangles: Indices, ends: Indices, of: Indices, two: Indices, facing: Matrix, stop: Indices,
    edges: Indices, bend: Matrix, bends: Record, section: Record, sides: Record,
):  # fmt: skip
    """Fill in how the surface bends (k, starts) at these edges (k). `stop` (E,): at which edges a polygon ends."""
    cut = section[0]
    for k in range(len(edges)):
        low, high = ends[edges[k]]
        one, other = two[edges[k]]
        cut.same = SAME * bend[k]
        _normalize(points[high] - points[low], cut.along)
        _normalize(facing[one] + facing[other], cut.up)
        _cross(cut.up, cut.along, cut.out)
        for n in range(len(STARTS)):
            for i in range(3):
                cut.point[i] = points[low, i] + STARTS[n] * (points[high, i] - points[low, i])
            _follow(points, triangles, ends, of, two, facing, stop, edges[k], one, cut, sides[0])
            _follow(points, triangles, ends, of, two, facing, stop, edges[k], other, cut, sides[1])
            _compare(sides[0], sides[1], bends[k, n])


@ieee_kernel
def _follow(
    points: Matrix, triangles: Indices, ends: Indices, of: Indices, two: Indices, facing: Matrix, stop: Indices,
    edge: int, t: int, cut: Record, side: Record,
):  # fmt: skip
    """Fill in the polygon of a section from an edge on, in the triangle t first. It ends at an edge of `stop`, and if
    three of its sides are known and together much longer than the longest."""
    side.size, total, longest = 0, 0.0, 0.0
    entry, leave = np.empty(3), np.empty(3)
    for i in range(3):
        entry[i] = cut.point[i]
    for _ in range(STEPS):
        # of the two other edges, the one that the plane crosses
        a, b = ends[edge]
        c = triangles[t, 0] + triangles[t, 1] + triangles[t, 2] - a - b
        at_c, at_b = _height(points[c], cut), _height(points[b], cut)
        end, at_end = (a, _height(points[a], cut)) if (at_c >= 0.0) == (at_b >= 0.0) else (b, at_b)
        share = min(max(at_end / (at_end - at_c), 0.0), 1.0) if at_end != at_c else 0.5
        for i in range(3):
            leave[i] = points[end, i] + share * (points[c, i] - points[end, i])
        length = length_between(leave, entry)
        up, out = row_times(facing[t], cut.up), row_times(facing[t], cut.out)
        size = np.sqrt(up * up + out * out)
        if size > LOWEST and up > 0.0:
            angle, last = 2.0 * out / (size + up), side.size - 1
            if side.size > 0 and abs(angle - side.angles[last]) < cut.same:
                joined = max(side.lengths[last] + length, 1e-300)
                side.angles[last] = (side.angles[last] * side.lengths[last] + angle * length) / joined
                side.lengths[last] += length
            elif side.size == MOST or (side.size >= 3 and total >= ENOUGH * longest):
                return
            else:
                side.lengths[side.size], side.angles[side.size] = length, angle
                side.size += 1
            total, longest = total + length, max(longest, side.lengths[side.size - 1])
        edge = _edge_between(ends, of, t, min(end, c), max(end, c))
        if edge < 0 or stop[edge]:
            return
        t = two[edge, 0] + two[edge, 1] - t
        for i in range(3):
            entry[i] = leave[i]


@ieee_kernel
def _compare(one: Record, other: Record, bend: Record):
    """Fill in how the polygons of both sides meet (`BEND`)."""
    first, second = _longest(one), _longest(other)
    within = 3.0 * min(first, second)
    bend.wide = max(first, second) / max(min(first, second), 1e-300)
    bend.jump = abs(_angle_at_edge(one, within) - _angle_at_edge(other, within))
    change, more = _change(one, within), _change(other, within)
    bend.change, bend.least = max(change, more), min(change, more)


@kernel
def _longest(side: Record):
    """Length [m] of the longest side of a polygon."""
    longest = 0.0
    for k in range(side.size):
        longest = max(longest, side.lengths[k])
    return longest


@ieee_kernel
def _angle_at_edge(side: Record, within: float):
    """Angle [rad] at the edge, of the line through the angles at the middles of the sides within a length [m]."""
    weight = middle = mean = 0.0
    begin = 0.0
    for k in range(side.size):
        share = max(min(side.lengths[k], within - begin), 0.0)
        weight += share
        middle += share * (begin + 0.5 * side.lengths[k])
        mean += share * side.angles[k]
        begin += side.lengths[k]
    middle, mean = middle / max(weight, 1e-300), mean / max(weight, 1e-300)
    begin, square, both = 0.0, RIDGE * within * within * weight, 0.0
    for k in range(side.size):
        share = max(min(side.lengths[k], within - begin), 0.0)
        away = begin + 0.5 * side.lengths[k] - middle
        square += share * away * away
        both += share * away * (side.angles[k] - mean)
        begin += side.lengths[k]
    return mean - middle * both / max(square, 1e-300)


@kernel
def _change(side: Record, within: float):
    """The largest difference [rad] of an angle within a length [m] from the first one."""
    change = begin = 0.0
    for k in range(side.size):
        if begin < within:
            change = max(change, abs(side.angles[k] - side.angles[0]))
        begin += side.lengths[k]
    return change


@kernel
def _height(point: Array, cut: Record):
    """Distance [m] of a point (3) from the plane of a section."""
    x, y, z = point[0] - cut.point[0], point[1] - cut.point[1], point[2] - cut.point[2]
    return x * cut.along[0] + y * cut.along[1] + z * cut.along[2]


@kernel
def _edge_between(ends: Indices, of: Indices, t: int, low: int, high: int):
    """The edge of triangle t with these ends; -1: none."""
    for i in range(3):
        edge = of[t, i]
        if ends[edge, 0] == low and ends[edge, 1] == high:
            return edge
    return -1


@ieee_kernel
def _normalize(vector: Array, out: Array):
    """Fill in the unit vector (3) of a vector (3)."""
    length = max(np.sqrt(row_times(vector, vector)), 1e-300)
    for i in range(3):
        out[i] = vector[i] / length


@kernel
def _cross(a: Array, b: Array, out: Array):
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
