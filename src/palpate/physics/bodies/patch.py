"""The fine surface mesh of reduced bodies, for loads and displacements, and its relation to the coarse one."""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Indices, Matrix, Vector3
from palpate.physics.contact.spread import Spreader, spread, spreader
from palpate.physics.geometry.graded import ranges
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint


def barycentric(mesh: Mesh, triangle: np.ndarray, foot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (k,3) of these triangles, and barycentric weights (k,3) of points on them, in [0, 1]."""
    corners = mesh.triangles[triangle].astype(np.int64)
    a, b, c = (mesh.vertices[corners[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    square = np.maximum(einsum("ij,ij->i", normal, normal), 1e-300)
    w1 = einsum("ij,ij->i", np.cross(foot - a, c - a), normal) / square
    w2 = einsum("ij,ij->i", np.cross(b - a, foot - a), normal) / square
    weights = np.clip(np.stack([1.0 - w1 - w2, w1, w2], axis=1), 0.0, 1.0)
    return corners, weights / weights.sum(axis=1, keepdims=True)


NEAR = 2e-3  # [m] Largest movement of the feet for which the vertices that may be sent stay listed
MEAN = 2.40816816  # [1] I of `true_patch`: mean of W over a biweight patch, weighted with the pressure
LEAST_MOMENT = 0.29  # [1] Mean square distance of a hat function from its vertex over the nodal area: regular triangles
MOST_FEET = 16  # with more feet they are listed in each step


class Listed(NamedTuple):
    """The vertices that may be sent while no foot moves farther than `NEAR`: their list is a cache."""

    vertices: Annotated[np.ndarray, "<i4", 1]  # (N,) ascending
    counts: Annotated[np.ndarray, "<i8", 1]  # (2,) number of them, and of the feet
    feet: Annotated[np.ndarray, "<f8", 2]  # [m] (MOST_FEET,3) at which they were listed
    flags: Annotated[np.ndarray, "|u1", 1]  # workspace: N rounded up to a multiple of 8, zero beyond the vertices


def listed(size: int) -> Listed:
    """An empty list for `size` vertices."""
    flags = np.zeros(-(-size // 8) * 8, np.uint8)
    return Listed(np.zeros(size, np.int32), np.zeros(2, np.int64), np.zeros((MOST_FEET, 3)), flags)


class FineMesh(NamedTuple):
    """The mesh of loads and displacements of a body that is condensed to a coarse surface."""

    spreader: Spreader  # of the patch of the terminal law without load
    reach: Annotated[np.ndarray, "<f4", 2]  # see `reaches`
    listed: Listed
    nodes: Annotated[np.ndarray, "<i4", 1]  # (N,) filled by `interpolate_fine`
    moved: Annotated[np.ndarray, "<f8", 2]  # [m] (N,3)


def fine_mesh(mesh: Mesh, radius: float, reach: float) -> FineMesh:
    """The fine mesh for a patch radius [m] and a reach [m]: the distance from the foot point within which all
    displacements are sent, fewer beyond it."""
    count = len(mesh.vertices)
    return FineMesh(
        spreader(mesh, radius), reaches(mesh.vertices, ranges(mesh.vertices, reach)), listed(count),
        np.zeros(count, np.int32), np.zeros((count, 3)),
    )  # fmt: skip


def lies_on(coarse: Mesh, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Coarse vertices (N,3) and weights (N,3) of each vertex of the fine mesh, see `barycentric`."""
    foot, _, triangle, _ = MeshClosestPoint(coarse).find(mesh.vertices)
    return barycentric(coarse, triangle, foot)


@ieee_kernel
def patch_of(fine: FineMesh, nodes: Indices, forces: Matrix, foot: Vector3, normal: Vector3):
    """A load, nodes (k) and forces [N] (k,3), and 1; without load a patch round the foot [m] (3), and 0."""
    if len(nodes) > 0:
        return nodes, forces, 1.0
    count = spread(fine.spreader, foot, normal, (-normal[0], -normal[1], -normal[2]))
    return fine.spreader.nodes[:count], fine.spreader.forces[:count], 0.0


@ieee_kernel
def respread(fine: FineMesh, forces: Matrix, foot: Vector3, normal: Vector3):
    """The sum of nodal forces [N] (k,3) on the fixed patch round the foot [m] (3): nodes, forces and 1."""
    x = y = z = 0.0
    for k in range(len(forces)):
        x, y, z = x + forces[k, 0], y + forces[k, 1], z + forces[k, 2]
    count = spread(fine.spreader, foot, normal, (x, y, z))
    return fine.spreader.nodes[:count], fine.spreader.forces[:count], 1.0


@kernel
def normal_force(pull: Matrix, normal: Vector3):
    """Sum [N] of nodal forces (k,3) against the outward normal (3)."""
    total = 0.0
    for k in range(len(pull)):
        total -= pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]
    return total


@kernel
def share_of(k: int, pull: Matrix, normal: Vector3, total: float):
    """Share [1] of node k in the normal force `total` [N]; equal shares if `total` is not positive."""
    if not total > 0.0:
        return 1.0 / len(pull)
    return -(pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]) / total


@kernel
def load_radius(vertices: Matrix, patch: Indices, pull: Matrix, normal: Vector3, total: float, least: Array):
    """R [m] of a load (k,3) on vertices `patch` of the fine mesh: twice the rms distance of its normal force from its
    centre, at least that of the hat function of a vertex; and how much narrower it is than the mesh resolves [1], 0 to
    13."""
    x0 = x1 = x2 = floor = 0.0
    for k in range(len(patch)):
        p, share = patch[k], abs(share_of(k, pull, normal, total))
        x0 += share * vertices[p, 0]
        x1 += share * vertices[p, 1]
        x2 += share * vertices[p, 2]
        floor += share * least[p]
    square = weight = 0.0
    for k in range(len(patch)):
        p, share = patch[k], abs(share_of(k, pull, normal, total))
        d0, d1, d2 = vertices[p, 0] - x0, vertices[p, 1] - x1, vertices[p, 2] - x2
        square += share * (d0 * d0 + d1 * d1 + d2 * d2)
        weight += share
    square /= max(weight, 1e-300)
    narrower = np.sqrt(2.0 * floor / max(square, 1e-2 * floor)) - 1.0
    return 2.0 * np.sqrt(max(square, floor)), max(narrower, 0.0)


@kernel
def compactness(patch: Indices, pull: Matrix, normal: Vector3, total: float, least: Array, radius: float):
    """q [1] of a load (k,3) of the radius R [m] on vertices `patch`, (sum of g_j²/A_j)^-1/(5 pi R²/9): 1 for a biweight
    patch, less if it is in several parts. least [m²] (N,) `LEAST_MOMENT` A of each vertex of the fine mesh."""
    uneven = 0.0
    for k in range(len(patch)):
        share = share_of(k, pull, normal, total)
        uneven += share * share / least[patch[k]]
    return 9.0 / max(5.0 * np.pi * radius * radius * LEAST_MOMENT * uneven, 1e-300)


def reaches(vertices: np.ndarray, within: np.ndarray) -> np.ndarray:
    """Coordinates [m] of each vertex and the squared distance [m²] from a foot within which it is sent, as rows (4,N)
    in single precision."""
    return np.ascontiguousarray(np.concatenate([vertices.T, within[None] ** 2]), dtype=np.float32)


@ieee_kernel
def _flag_near(reach: Matrix, foot: Array, more: bool, flags: Indices):
    """Flag the vertices that a foot [m] (3) can reach within `NEAR`, in addition to those flagged if `more`. The limit
    is wider by 10 % of it, for the rounding in single precision."""
    x, y, z, square = reach[0], reach[1], reach[2], reach[3]
    f0, f1, f2 = np.float32(foot[0]), np.float32(foot[1]), np.float32(foot[2])
    wider = np.float32(1.1 * NEAR)
    for p in range(len(x)):
        d0, d1, d2, limit = x[p] - f0, y[p] - f1, z[p] - f2, np.sqrt(square[p]) + wider
        flag = np.uint8(d0 * d0 + d1 * d1 + d2 * d2 <= limit * limit)
        flags[p] = flags[p] | flag if more else flag


@ieee_kernel
def list_near(reach: Matrix, feet: Matrix, listed: Listed):
    """List the vertices that may be sent, unless the last list is still valid. Returns their number."""
    kept = listed.counts[1] == len(feet)
    for c in range(len(feet)):
        square = 0.0
        for i in range(3):
            square += (feet[c, i] - listed.feet[min(c, MOST_FEET - 1), i]) ** 2
        kept &= square <= NEAR * NEAR
    if kept:
        return listed.counts[0]
    flags, count = listed.flags, 0
    for c in range(len(feet)):
        _flag_near(reach, feet[c], c > 0, flags)
        listed.feet[min(c, MOST_FEET - 1)] = feet[c]
    eight = flags.view(np.uint64)
    for k in range(len(eight)):
        if eight[k] == 0:
            continue
        for p in range(8 * k, 8 * k + 8):
            if flags[p] != 0:
                listed.vertices[count] = p
                count += 1
    listed.counts[0], listed.counts[1] = count, len(feet) if len(feet) <= MOST_FEET else -1
    return count


@ieee_kernel
def _is_sent(reach: Matrix, p: int, feet: Matrix):
    """Whether a vertex is within its distance of a foot, in single precision."""
    for c in range(len(feet)):
        d0 = reach[0, p] - np.float32(feet[c, 0])
        d1 = reach[1, p] - np.float32(feet[c, 1])
        d2 = reach[2, p] - np.float32(feet[c, 2])
        if d0 * d0 + d1 * d1 + d2 * d2 <= reach[3, p]:
            return True
    return False


@ieee_kernel
def interpolate_fine(
    corners: Indices,
    weights: Matrix,
    u: Matrix,
    reach: Matrix,
    feet: Matrix,
    listed: Listed,
    nodes: Indices,
    moved: Matrix,
):
    """Displacements of the fine mesh round the feet, from u [m] (V,3) of the coarse vertices: fills `nodes` and `moved`
    [m]; returns their number.

    corners, weights  (N,3) coarse vertices and weights of each fine vertex, see `barycentric`
    reach  (4,N) see `reaches`;  feet [m] (c,3);  listed  see `list_near`
    """
    count = 0
    for k in range(list_near(reach, feet, listed)):
        p = listed.vertices[k]
        if not _is_sent(reach, p, feet):
            continue
        nodes[count] = p
        a, b, c = corners[p, 0], corners[p, 1], corners[p, 2]
        for i in range(3):
            moved[count, i] = weights[p, 0] * u[a, i] + weights[p, 1] * u[b, i] + weights[p, 2] * u[c, i]
        count += 1
    return count


@kernel
def add_pressure(pull: Matrix, patch: Indices, normal: Vector3, areas: Array, nodes: Indices, push: Array, out: Array):
    """Add to `out` [Pa] (t,) the pressure at the vertices `nodes` (t,) due to nodal forces (k,3) on `patch`: their part
    against the normal over the nodal area. push (N,): workspace, zero before and after."""
    for k in range(len(patch)):
        p = patch[k]
        force = pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]
        push[p] = -force / areas[p]
    for k in range(len(nodes)):
        out[k] += push[nodes[k]]
    for k in range(len(patch)):
        push[patch[k]] = 0.0


def hat_moments(mesh: Mesh) -> np.ndarray:
    """Mean square distance [m²] (V,) of the hat function of each vertex from the vertex."""
    corner = mesh.vertices[mesh.triangles]
    area = 0.5 * np.linalg.norm(mesh.face_vectors, axis=1)
    moment, weight = np.zeros(len(mesh.vertices)), np.zeros(len(mesh.vertices))
    for k in range(3):
        first, second = (corner[:, (k + i) % 3] - corner[:, k] for i in (1, 2))
        square = np.sum(first * first + second * second + first * second, axis=1)
        np.add.at(moment, mesh.triangles[:, k], area * square / 30.0)
        np.add.at(weight, mesh.triangles[:, k], area / 3.0)
    return moment / weight


@kernel
def patch_radius(points: Matrix, moments: Array, nodes: Indices, count: int, share: Matrix):
    """Radius R [m] of a patch: twice the rms distance of its force from its centre, which is the radius of a biweight
    patch, and 1.41 times that of a uniform one. nodes (>= count) vertices of the patch, share (V,3) with their
    shares in the first column, used without sign."""
    total = x0 = x1 = x2 = 0.0
    for k in range(count):
        v = nodes[k]
        w = abs(share[v, 0])
        total += w
        x0 += w * points[v, 0]
        x1 += w * points[v, 1]
        x2 += w * points[v, 2]
    x0, x1, x2 = x0 / total, x1 / total, x2 / total
    square = 0.0
    for k in range(count):
        v = nodes[k]
        d0, d1, d2 = points[v, 0] - x0, points[v, 1] - x1, points[v, 2] - x2
        square += abs(share[v, 0]) * (d0 * d0 + d1 * d1 + d2 * d2 + moments[v])
    return 2.0 * np.sqrt(square / total)
