"""Distribution of the contact force over the surface nodes round the foot point.

    f_j = w_j f,    w_j = A_j k(d_j/R) / sum_l A_l k(d_l/R)

A_j [m²] nodal area, d_j [m] distance of node j to the foot point, R [m] radius of influence, k a kernel that is zero at
R, so that the weights change continuously while the foot point moves. The weights sum to one, so the force is conserved
on any mesh. Nodes whose normal points away from the contact's normal, as on the back of a thin or folded body, are
excluded: w_j is multiplied by x² (3 - 2x), where x = n_j.n / `FACES` < 1, so that a contact that turns at an edge adds
and removes the side of the body continuously.

A foot point that follows the finger to another part of the surface may lie off the surface (`geometry.proxy`), where
few nodes are within R, or none. If the nearest node is at d_0 > a = `OFF` R, d_j² is reduced by d_0² - a²: the patch
keeps (1 - `OFF`²)^½ = 87 % of its radius. d_0² is a smooth minimum, exact for a plane,

    d_0² = -tau log(sum_j A_j exp(-d_j²/tau - `_averted`)/(pi tau)),    tau = `SMOOTH` R²,

since between two faces the rate of the nearest distance changes its sign, and a viscous body and fingertip respond to
that at once. A point of the surface may be as far from all nodes
as the radius of the circle round a triangle, so that a is at least that of the longest edge L, L/3^½.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.compiler.kernel import kernel
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import nearest_weights

KERNELS = ("biweight", "wendland", "cosine", "hertz")
FACES = 0.5  # [1] cosine to the contact's normal below which a node bears less
OFF = 0.5  # [1] of R, distance of the nearest node beyond which the foot counts as off the surface
SMOOTH = 1.0 / 12.0  # [1] of R²; tau of the smooth minimum


@kernel(error_model="numpy")
def kernel_value(kind, q):
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


@kernel(error_model="numpy")
def _cell(x, count):
    # limited before the conversion to an integer, which would overflow for distant points
    return int(min(max(x, 0.0), count - 1.0))


@kernel(error_model="numpy")
def _cells(foot, shift, scalars, shape):
    """The cell (3) at a foot point that is shifted by `shift` [m] along each axis, limited to the grid."""
    return (
        _cell((foot[0] + shift - scalars[2]) / scalars[5], shape[0]),
        _cell((foot[1] + shift - scalars[3]) / scalars[5], shape[1]),
        _cell((foot[2] + shift - scalars[4]) / scalars[5], shape[2]),
    )


@kernel(error_model="numpy")
def nearest_triangle(point, normal, points, triangles, vectors):
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

    scalars: Annotated[np.ndarray, "<f8", 1]
    """R [m], kind (index into KERNELS), origin (3) and side [m] of the grid, longest edge of a triangle [m]."""
    shape: Annotated[np.ndarray, "<i8", 1]
    first: Annotated[np.ndarray, "<i4", 1]
    order: Annotated[np.ndarray, "<i4", 1]
    near: Annotated[np.ndarray, "<f8", 2]  # (V,7) position, normal and area of each vertex, in the order of the grid
    vertices: Annotated[np.ndarray, "<f8", 2]  # [m] (V,3)
    triangles: Annotated[np.ndarray, "<i4", 2]  # [1] (T,3)
    vectors: Annotated[np.ndarray, "<f8", 2]  # [m²] (T,3) along the triangles' normals
    box: Annotated[np.ndarray, "<f8", 2]  # [m] (2,3) limits of foot points, far outside the mesh
    nodes: Annotated[np.ndarray, "<i4", 1]  # [1] (V)
    weights: Annotated[np.ndarray, "<f8", 1]  # [1] (V)
    forces: Annotated[np.ndarray, "<f8", 2]  # [N] (V,3)


TABLES = Spreader._fields[:-3]  # fields that no kernel writes


def spreader(mesh: Mesh, radius: float, kernel: str = "biweight") -> Spreader:
    """The spreader for a surface, a radius of influence R > 0 [m] and one of KERNELS. ValueError: an unknown kernel, a
    radius that is not positive."""
    if kernel not in KERNELS:
        raise ValueError(f"kernel {kernel!r}: unknown. Kernels: {', '.join(KERNELS)}.")
    if not 0.0 < radius < math.inf:
        raise ValueError(f"radius {radius} m: expected a positive number")
    origin, side, shape, first, order = cells(mesh.vertices, radius)
    near = np.concatenate([mesh.vertices, mesh.normals, mesh.areas[:, None]], axis=1)[order]
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    margin, size = 20 * float(np.max(high - low)), max(len(near), 3)
    vertices, triangles, faces = map(np.ascontiguousarray, (mesh.vertices, mesh.triangles, mesh.face_vectors))
    edges = np.linalg.norm(np.diff(vertices[triangles[:, [0, 1, 2, 0]]], axis=1), axis=2)
    scalars = np.array([radius, KERNELS.index(kernel), *origin, side, float(edges.max(initial=0.0))])
    return Spreader(
        scalars, shape, first, order, near, vertices, triangles, faces,
        np.stack([low - margin, high + margin]), np.zeros(size, np.int32), np.zeros(size), np.zeros((size, 3)),
    )  # fmt: skip


@kernel
def _facing(faces):
    """Factor [1] on the weight of a node whose normal has this cosine, in (0, `FACES`), to the contact's."""
    share = faces / FACES
    return share * share * (3.0 - 2.0 * share)


@kernel(error_model="numpy")
def _averted(faces):
    """Part of d_j² over tau [1] of a node whose normal has this cosine > 0 to the contact's: from 0 to inf at 0."""
    return FACES / faces - 1.0 if faces < FACES else 0.0


@kernel(error_model="numpy")
def _weigh(s, foot, normal, r, shift):
    """Fill `nodes` and `weights` [m²] with the nodes that face `normal` and have d² - shift < R². Returns their number,
    and the least d² [m²] of them, `_averted` included; inf: none exists."""
    kind, shape, first, order, near = int(s.scalars[1]), s.shape, s.first, s.order, s.near
    reach = r * r + shift
    wide = r if shift == 0.0 else math.sqrt(reach)
    lo, hi = _cells(foot, -wide, s.scalars, shape), _cells(foot, wide, s.scalars, shape)
    count, least = 0, np.inf
    for i in range(lo[0], hi[0] + 1):
        for j in range(lo[1], hi[1] + 1):
            row = (i * shape[1] + j) * shape[2]
            for at in range(first[row + lo[2]], first[row + hi[2] + 1]):
                x, y, z = near[at, 0] - foot[0], near[at, 1] - foot[1], near[at, 2] - foot[2]
                square = x * x + y * y + z * z
                if square >= reach:
                    continue
                faces = near[at, 3] * normal[0] + near[at, 4] * normal[1] + near[at, 5] * normal[2]
                if faces <= 0.0:
                    continue
                weight = near[at, 6] * kernel_value(kind, math.sqrt(max(square - shift, 0.0)) / r)
                if faces < FACES:
                    weight *= _facing(faces)
                    square += SMOOTH * r * r * _averted(faces)
                least = min(least, square)
                if weight > 0.0:
                    s.nodes[count], s.weights[count] = order[at], weight
                    count += 1
    return count, least


@kernel
def _on_surface(s, r):
    """Largest d_0² [m²] of a foot that counts as on the surface."""
    return max((OFF * r) ** 2, s.scalars[6] ** 2 / 3.0)


@kernel(error_model="numpy")
def _clearance(s, foot, normal, r, least):
    """d_0² - a² [m²] as a smooth minimum, 0 at the exact `least` d_0² = a²; nodes that hardly count are left out."""
    near, off, tau = s.near, least - _on_surface(s, r), SMOOTH * r * r
    reach = math.sqrt(least + 20.0 * tau)
    lo, hi = _cells(foot, -reach, s.scalars, s.shape), _cells(foot, reach, s.scalars, s.shape)
    total = 0.0
    for i in range(lo[0], hi[0] + 1):
        for j in range(lo[1], hi[1] + 1):
            row = (i * s.shape[1] + j) * s.shape[2]
            for at in range(s.first[row + lo[2]], s.first[row + hi[2] + 1]):
                x, y, z = near[at, 0] - foot[0], near[at, 1] - foot[1], near[at, 2] - foot[2]
                faces = near[at, 3] * normal[0] + near[at, 4] * normal[1] + near[at, 5] * normal[2]
                if faces > 0.0:
                    total += near[at, 6] * math.exp((least - (x * x + y * y + z * z)) / tau - _averted(faces))
    return max(off - tau * math.log(max(total / (math.pi * tau), 1e-3)), 0.0) * min(off / tau, 1.0)


@kernel(error_model="numpy")
def _off_surface(s, foot, normal, r, least):
    """Fill `nodes` and `weights` for a foot without a node within OFF R, `least` [m²] being d_0² if one is within R,
    else inf; returns their number, 0 if the foot lies on a triangle that is larger than R, or no node faces
    `normal`."""
    most, wide = 4.0 * (s.box[1, 0] - s.box[0, 0] + s.box[1, 1] - s.box[0, 1] + s.box[1, 2] - s.box[0, 2]), 2.0 * r
    while least == np.inf and wide < most:
        least = _weigh(s, foot, normal, r, wide * wide - r * r)[1]
        wide *= 2.0
    if not _on_surface(s, r) < least < np.inf:
        return 0
    return _weigh(s, foot, normal, r, _clearance(s, foot, normal, r, least))[0]


@kernel(error_model="numpy")
def spread(spreader, foot, normal, force, radius=0.0):
    """Fill `nodes`, `weights` [1] and `forces` [N] of a `Spreader` for a `force` at `foot` [m]. Returns their number.

    normal: outward unit normal [1] (3) of the surface at the foot point;  radius [m]  R, 0: that of the spreader

    If no node is in range of a foot on the surface, the force is distributed over the corners of the nearest triangle
    by the barycentric coordinates of its point nearest to the foot. Else the work depends on the number of nodes near
    the foot, not on the mesh.
    """
    s, nodes, weights, forces = spreader, spreader.nodes, spreader.weights, spreader.forces
    r = radius if radius > 0.0 else s.scalars[0]
    count, least = _weigh(s, foot, normal, r, 0.0)
    if count == 0:
        count = _off_surface(s, foot, normal, r, np.inf)
    elif least > _on_surface(s, r):
        count = _off_surface(s, foot, normal, r, least)
    total = 0.0
    for at in range(count):
        total += weights[at]
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
