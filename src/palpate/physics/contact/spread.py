"""Distribution of the contact force over the surface nodes round the foot point.

    f_j = w_j f,    w_j = A_j k(d_j/R) / sum_l A_l k(d_l/R)

A_j [m²] nodal area, d_j [m] distance of node j to the foot point, R [m] radius of influence, k a kernel that is zero at
R, so that the weights change continuously while the foot point moves. The weights sum to one, so the force is conserved
on any mesh. Nodes whose normal points away from the contact's normal, as on the back of a thin or folded body, are
excluded: where x = n_j.n / `FACES` < 1, w_j is multiplied by g_j = x² (3 - 2x) and d_j² is divided by x, so that a
contact that turns at an edge adds and removes the side of the body continuously.

A foot point that follows the finger to another part of the surface may lie off the surface (`geometry.proxy`), where
few nodes are within R, or none, or only some that hardly face the contact. There the patch is a cone of 45 degrees
along the contact's normal: with d_0 >= 0 and the height h_j = (x_j - foot).n of node j above the foot,

    w_j ~ A_j g_j k(((d_j² - min(h_j², d_0²)) / (R² + d_0²))^½)

(with a smooth minimum, see `_lowered`) and d_0² is the least one with which the patch has the area of one whose foot is
a = `OFF` R above a plane,

    sum_j A_j g_j k >= integral_a^R k(h/R) 2 pi h dh.

Within `SOFT` of this least area it grows into it by a parabola: a kink there is a kink of the patch's motion, which
beams or springs that have not yielded answer within a tick.

A patch above a plane has (1 - `OFF`²)^½ = 87 % of its radius at the height a, and grows with the height, to 118 % at
1.6 R. Nodes that hardly face the contact are far and take no more than their share of it. So the load passes from one
side of a body to the other while the contact turns. (With the nearest node in place of the area, it passed at once
where a nearer side began to face the contact. With d_j² - d_0² for all nodes the nearest side took all of the patch.
Without the cone a patch far in front of a foot moves over an edge faster than the foot: at 12 mm a turn at 10 rad/s and
the foot together moved it at 300 mm/s, twice as fast as the foot, and viscous tissue resisted with 1.4 times the
force.) On a coarse mesh a point of the surface may be as far from all nodes as the radius of the circle round a
triangle, so that a is at least that of the longest edge L, L/3^½.
"""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Indices, Matrix, Vector3
from palpate.physics.geometry.felt.bearing import Bearing
from palpate.physics.geometry.mesh import Mesh, once_per_mesh
from palpate.physics.geometry.mesh_closest import nearest_weights

KERNELS = ("biweight", "wendland", "cosine", "hertz")
NODES = element_type({"position": (3,), "normal": (3,), "area": ()})
"""A vertex in the order of the grid: position [m], normal [1], area that bears load [m²]."""
FACES = 0.5  # [1] cosine to the contact's normal below which a node bears less
TINY = 1e-9  # [1] x that cannot be divided by
OFF = 0.5  # [1] of R, height above a plane from which the foot counts as off the surface
WIDER = 1.5  # [1] factor from one range in which nodes are looked for to the next
SOFT = 0.3  # [1] of the least area, from which on a patch begins to be widened
RINGS = 16  # of the sum for the least area
CLOSE = 1e-12  # [1] by which the area of a patch may differ from the least one


@ieee_kernel
def kernel_value(kind: int, q: float):
    """k(q), 1 at q = 0, 0 from q = 1 on: 0 biweight (1-q²)², 1 Wendland C² (1-q)⁴(4q+1), 2 raised cosine,
    3 Hertz's pressure (1-q²)^½."""
    if q >= 1.0:
        return 0.0
    if kind == 3:
        return math.sqrt(1.0 - q * q)
    if kind == 0:
        x = 1.0 - q * q
        return x * x
    if kind == 1:
        x = (1.0 - q) * (1.0 - q)
        return x * x * (4.0 * q + 1.0)
    return 0.5 * (1.0 + math.cos(math.pi * q))


def kernel_values(name: str, q: ArrayLike) -> np.ndarray:
    """Kernel `name` of KERNELS at q = d/R >= 0 [1] (...)."""
    flat = np.asarray(q, float)
    kind = KERNELS.index(name)
    return np.array([kernel_value(kind, float(x)) for x in flat.ravel()]).reshape(flat.shape)


def cells(points: np.ndarray, side: float) -> tuple[np.ndarray, float, np.ndarray, np.ndarray, np.ndarray]:
    """A uniform grid over points [m] (V,3): its corner [m] (3), the side of a cell [m], number of cells along each axis
    (3), index of each cell's first point in the list (C+1), cells in C order, and the list of points by cell (V).

    The side is larger than requested if there would be many more cells than points.
    """
    origin = points.min(axis=0)
    extent = points.max(axis=0) - origin
    while np.prod(np.floor(extent / side) + 1.0) > 4 * len(points) + 100_000:
        side *= 1.25
    shape = (np.floor(extent / side) + 1.0).astype(np.int64)
    cell = np.minimum(((points - origin) / side).astype(np.int64), shape - 1)
    flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    first = np.zeros(int(shape.prod()) + 1, np.int32)
    np.cumsum(np.bincount(flat, minlength=len(first) - 1), out=first[1:])
    return origin, side, shape, first, np.argsort(flat, kind="stable").astype(np.int32)


@ieee_kernel
def _cell(x: float, count: int):
    # limited before the conversion to an integer, which would overflow for distant points
    return int(min(max(x, 0.0), count - 1.0))


@ieee_kernel
def _cells(foot: Vector3, shift: float, origin: Vector3, side: float, shape: Indices):
    """The cell (3) at a foot point that is shifted by `shift` [m] along each axis, limited to the grid."""
    return (
        _cell((foot[0] + shift - origin[0]) / side, shape[0]),
        _cell((foot[1] + shift - origin[1]) / side, shape[1]),
        _cell((foot[2] + shift - origin[2]) / side, shape[2]),
    )


@ieee_kernel
def nearest_triangle(point: Array, normal: Vector3, points: Matrix, triangles: Indices, vectors: Matrix):
    """The triangle nearest to a point [m] (3), and the weights of the second and third corner at its nearest point.

    Triangles that face away from `normal` are used only if no others exist; -1: no triangle has an area.
    points [m] (V,3), triangles (T,3), vectors [m²] (T,3) along the triangles' normals
    """
    best, least, faces, v, w = -1, np.inf, False, 0.0, 0.0
    for t in range(len(triangles)):
        facing = vectors[t, 0] * normal[0] + vectors[t, 1] * normal[1] + vectors[t, 2] * normal[2]
        if facing == 0.0 or (faces and facing < 0.0):
            continue
        a, b, c = points[triangles[t, 0]] - point, points[triangles[t, 1]] - point, points[triangles[t, 2]] - point
        y, z, _ = nearest_weights(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])
        square = np.sum(((1.0 - y - z) * a + y * b + z * c) ** 2)
        if square < least or (facing > 0.0 and not faces):
            best, least, faces, v, w = t, square, facing > 0.0, y, z
    return best, v, w


class Spreader(NamedTuple):
    """Tables of a mesh for the distribution of forces, and the last result; shape, first and order: see `cells`."""

    radius: float  # [m] R
    kind: int  # index into KERNELS
    origin: tuple[float, float, float]  # [m] of the grid
    side: float  # [m] of its cells
    longest: float  # [m] edge of a triangle
    shape: Annotated[np.ndarray, "<i8", 1]
    first: Annotated[np.ndarray, "<i4", 1]
    order: Annotated[np.ndarray, "<i4", 1]
    near: Annotated[np.ndarray, NODES, 1]  # (V)
    vertices: Annotated[np.ndarray, "<f8", 2]  # [m] (V,3)
    triangles: Annotated[np.ndarray, "<i4", 2]  # [1] (T,3)
    vectors: Annotated[np.ndarray, "<f8", 2]  # [m²] (T,3) along the triangles' normals
    box: Annotated[np.ndarray, "<f8", 2]  # [m] (2,3) limits of foot points, far outside the mesh
    nodes: Annotated[np.ndarray, "<i4", 1]  # [1] (V)
    weights: Annotated[np.ndarray, "<f8", 1]  # [1] (V)
    forces: Annotated[np.ndarray, "<f8", 2]  # [N] (V,3)


TABLES = Spreader._fields[:-3]  # fields that no kernel writes


def spreader(mesh: Mesh, radius: float, kernel: str = "biweight", bearing: Bearing | None = None) -> Spreader:
    """The spreader for a surface, a radius of influence R > 0 [m] and one of KERNELS.

    bearing  the part of the surface that bears load; None: all of it

    ValueError: an unknown kernel, a radius that is not positive.
    """
    if kernel not in KERNELS:
        raise ValueError(f"kernel {kernel!r}: unknown. Kernels: {', '.join(KERNELS)}.")
    if not 0.0 < radius < math.inf:
        raise ValueError(f"radius {radius} m: expected a positive number")
    tables = _tables(mesh, float(radius)) if bearing is None else _make_tables(mesh, float(radius), *bearing)
    size = max(len(mesh.vertices), 3)
    room = (np.zeros(size, np.int32), np.zeros(size), np.zeros((size, 3)))
    return Spreader._make([float(radius), KERNELS.index(kernel), *tables, *room])


@once_per_mesh
def _tables(mesh: Mesh, radius: float) -> tuple[Any, ...]:
    """The tables of a spreader of a surface whose whole area bears load."""
    return _make_tables(mesh, radius, mesh.areas, mesh.normals)


def _make_tables(mesh: Mesh, radius: float, areas: np.ndarray, normals: np.ndarray) -> tuple[Any, ...]:
    """The fields of a `Spreader` from `origin` to `box`; areas [m²] (V) that bear load, and their normals [1] (V,3)."""
    origin, side, shape, first, order = cells(mesh.vertices, radius)
    near = np.zeros(len(areas), NODES)
    near["position"], near["normal"], near["area"] = mesh.vertices[order], normals[order], areas[order]
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    margin = 20 * float(np.max(high - low))
    vertices, triangles, faces = map(np.ascontiguousarray, (mesh.vertices, mesh.triangles, mesh.face_vectors))
    around = vertices[triangles[:, [0, 1, 2, 0]]]
    edges = np.linalg.norm(np.diff(around, axis=1), axis=2)
    x, y, z = map(float, origin)
    return (
        (x, y, z), float(side), float(edges.max(initial=0.0)), shape, first, order, near, vertices, triangles, faces,
        np.stack([low - margin, high + margin]),
    )  # fmt: skip


@ieee_kernel
def _gather(s: Spreader, foot: Vector3, normal: Vector3, reach: float):
    """Fill `nodes`, `weights` with A_j g_j [m²] and `forces[:, :2]` with d_j²/x and h_j² [m²] of the nodes that face
    `normal` and for which d_j²/x is within `reach`² [m²]. Returns their number."""
    shape, first, order, near, count = s.shape, s.first, s.order, s.near, 0
    lo, hi = _cells(foot, -reach, s.origin, s.side, shape), _cells(foot, reach, s.origin, s.side, shape)
    for i in range(lo[0], hi[0] + 1):
        for j in range(lo[1], hi[1] + 1):
            row = (i * shape[1] + j) * shape[2]
            for at in range(first[row + lo[2]], first[row + hi[2] + 1]):
                p, n = near[at].position, near[at].normal
                x, y, z = p[0] - foot[0], p[1] - foot[1], p[2] - foot[2]
                square = x * x + y * y + z * z
                if square >= reach * reach:
                    continue
                share = (n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2]) / FACES
                if share <= 0.0:
                    continue
                area = near[at].area
                if share < 1.0:
                    area *= share * share * (3.0 - 2.0 * share)
                    square /= max(share, TINY)
                if square < reach * reach:
                    height = x * normal[0] + y * normal[1] + z * normal[2]
                    s.nodes[count], s.weights[count] = order[at], area
                    s.forces[count, 0], s.forces[count, 1] = square, height * height
                    count += 1
    return count


@ieee_kernel
def _lowered(height: float, shift: float):
    """The smaller one of h_j² and d_0² = `shift` [m²], with a parabola up to h_j² = 2 d_0² in place of the kink. With
    that the patch of an inclined foot next to a groove of 8 mm moved 20 % faster within 0.1 mm, as d_0² passed the
    heights of its nodes, onto beams that had not yielded."""
    return height - 0.25 * height * height / shift if height < 2.0 * shift else shift


@ieee_kernel
def _cone_value(kind: int, square: float, height: float, shift: float, wide: float):
    """k of a node, from d_j²/x and h_j² [m²], for d_0² = `shift` [m²] and (R² + d_0²)^½ = `wide` [m]. It gets numbers:
    passed to each call, the arrays take 12 times as long as the rest of `spread`."""
    square -= _lowered(height, shift)
    return kernel_value(kind, math.sqrt(max(square, 0.0)) / wide) if square < wide * wide else 0.0


@ieee_kernel
def _area(s: Spreader, count: int, r: float, shift: float):
    """Sum of A_j g_j k [m²] of the gathered nodes for d_0² = `shift` [m²]."""
    kind, wide, total = s.kind, math.sqrt(r * r + shift), 0.0
    for at in range(count):
        total += s.weights[at] * _cone_value(kind, s.forces[at, 0], s.forces[at, 1], shift, wide)
    return total


@ieee_kernel
def _least_area(s: Spreader, r: float):
    """Least area [m²] of a patch (a sum over rings, within 1 %); 0: a triangle is larger than R."""
    kind, low, total = s.kind, max(OFF, s.longest / (math.sqrt(3.0) * r)), 0.0
    width = max(1.0 - low, 0.0) / RINGS
    for ring in range(RINGS):
        q = low + (ring + 0.5) * width
        total += kernel_value(kind, q) * q
    return 2.0 * math.pi * r * r * width * total


@ieee_kernel
def _smooth_area(area: float, least: float):
    """The larger of a patch's `area` and the `least` one [m²], with a continuous slope: a parabola between both within
    `SOFT` of the least one."""
    above = area - (1.0 - SOFT) * least
    if above <= 0.0:
        return least
    return area if area >= (1.0 + SOFT) * least else least + above * above / (4.0 * SOFT * least)


@ieee_kernel
def _within(s: Spreader, count: int, r: float, shift: float):
    """Leave out the gathered nodes that are not in the patch for d_0² = `shift` [m²], nor for less. Returns the number
    of the others, whose order remains, so that sums keep their bits."""
    wide, kept = math.sqrt(r * r + shift), 0
    for at in range(count):
        square, height = s.forces[at, 0], s.forces[at, 1]
        if square - _lowered(height, shift) < wide * wide:
            s.nodes[kept], s.weights[kept] = s.nodes[at], s.weights[at]
            s.forces[kept, 0], s.forces[kept, 1] = square, height
            kept += 1
    return kept


@ieee_kernel
def _shift(s: Spreader, count: int, r: float, least: float, high: float, first: float, last: float):
    """The shift d_0² [m²] in [0, `high`] with which the patch has the area `least`, from the areas `first` and `last`
    [m²] at both ends: regula falsi (Illinois). And the number of the gathered nodes that are left, those of the patch
    among them."""
    low, below, above = 0.0, first - least, last - least
    if above <= 0.0:
        return high, count
    if below >= 0.0:
        return 0.0, count
    side, count = 0, _within(s, count, r, high)
    for _ in range(100):
        middle = (low * above - high * below) / (above - below)
        value = _area(s, count, r, middle) - least
        if abs(value) <= CLOSE * least or not low < middle < high:
            return middle, count
        if value < 0.0:
            low, below, above, side = middle, value, 0.5 * above if side < 0 else above, -1
        else:
            high, above, below, side = middle, value, 0.5 * below if side > 0 else below, 1
            count = _within(s, count, r, high)
    return high, count


@ieee_kernel
def _weigh(s: Spreader, gathered: int, r: float, shift: float):
    """Turn the gathered nodes into those of the patch, with their weights [m²]; their number and the sum of these."""
    kind, wide, count, total = s.kind, math.sqrt(r * r + shift), 0, 0.0
    for at in range(gathered):
        weight = s.weights[at] * _cone_value(kind, s.forces[at, 0], s.forces[at, 1], shift, wide)
        if weight > 0.0:
            s.nodes[count], s.weights[count] = s.nodes[at], weight
            count, total = count + 1, total + weight
    return count, total


@ieee_kernel
def _areas(s: Spreader, feet: Matrix, normals: Matrix, areas: Array):
    for k in range(len(feet)):
        foot, normal = (feet[k, 0], feet[k, 1], feet[k, 2]), (normals[k, 0], normals[k, 1], normals[k, 2])
        areas[k] = _weigh(s, _gather(s, foot, normal, s.radius), s.radius, 0.0)[1]


def patch_areas(s: Spreader, feet: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Sum of A_j g_j k [m²] (n) of the patches at feet [m] (n,3) on a surface with the normals [1] (n,3)."""
    areas = np.empty(len(feet))
    _areas(s, feet, normals, areas)
    return areas


@ieee_kernel
def _farthest(s: Spreader, foot: Vector3):
    """Distance [m] of the farthest corner of the grid; 0 for a foot beyond its box."""
    square = 0.0
    for k in range(3):
        if not s.box[0, k] <= foot[k] <= s.box[1, k]:
            return 0.0
        near = foot[k] - s.origin[k]
        square += max(abs(near), abs(near - s.shape[k] * s.side)) ** 2
    return math.sqrt(square)


@ieee_kernel
def _widen(s: Spreader, foot: Vector3, normal: Vector3, r: float, area: float, least: float):
    """The nodes of a patch that is widened from its `area` to the `least` one [m²], as in `_weigh`."""
    reach, most, gathered, high, last = r, 3.0 * _farthest(s, foot), 0, 0.0, 0.0
    while reach < most:
        reach *= WIDER
        gathered, high = _gather(s, foot, normal, reach), 0.5 * (reach * reach - r * r)  # nodes beyond have k = 0
        last = _area(s, gathered, r, high)
        if last >= least:
            break
    shift, gathered = _shift(s, gathered, r, least, high, area, last)
    return _weigh(s, gathered, r, shift)


@ieee_kernel
def spread(spreader: Spreader, foot: Vector3, normal: Vector3, force: Vector3, radius: float = 0.0, share: float = 1.0):
    """Fill `nodes`, `weights` [1] and `forces` [N] of a `Spreader` for a `force` at `foot` [m]. Returns their number.

    normal: outward unit normal [1] (3) of the surface at the foot point;  radius [m]  R, 0: that of the spreader
    share   [1] of the patch that is on this surface; the rest of its area is on another one

    If no node is in range of a foot on the surface, the force is distributed over the corners of the nearest triangle
    by the barycentric coordinates of its point nearest to the foot. Else the work depends on the number of nodes near
    the foot, not on the mesh.
    """
    s, nodes, weights, forces = spreader, spreader.nodes, spreader.weights, spreader.forces
    r = radius if radius > 0.0 else s.radius
    count, total = _weigh(s, _gather(s, foot, normal, r), r, 0.0)
    area = _smooth_area(total, share * _least_area(s, r))
    if total < area:
        count, total = _widen(s, foot, normal, r, total, area)
    for at in range(count):
        weights[at] /= total
        for k in range(3):
            forces[at, k] = weights[at] * force[k]
    if count > 0:
        return count
    # no node in range: the nearest triangle
    point = np.empty(3)  # limited to the box, so that squares of distances are finite
    for i in range(3):
        point[i] = min(max(foot[i], s.box[0, i]), s.box[1, i])
    nearest, v, w = nearest_triangle(point, normal, s.vertices, s.triangles, s.vectors)
    if nearest < 0:
        return 0
    shares = (max(1.0 - v - w, 0.0), max(v, 0.0), max(w, 0.0))
    total = shares[0] + shares[1] + shares[2]
    for k in range(3):
        nodes[k], weights[k] = s.triangles[nearest, k], shares[k] / total
        for i in range(3):
            forces[k, i] = weights[k] * force[i]
    return 3
