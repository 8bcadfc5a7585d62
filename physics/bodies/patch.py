"""Interpolation between the coarse surface of a reduced body and the finer mesh that is touched and drawn."""

from __future__ import annotations

import numpy as np

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel


def barycentric(mesh: Mesh, triangle: np.ndarray, foot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (k,3) of these triangles and weights (k,3) of points on them; weights in [0, 1] that sum to 1."""
    corners = mesh.triangles[triangle].astype(np.int64)
    a, b, c = (mesh.vertices[corners[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    square = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    w1 = np.einsum("ij,ij->i", np.cross(foot - a, c - a), normal) / square
    w2 = np.einsum("ij,ij->i", np.cross(b - a, foot - a), normal) / square
    weights = np.clip(np.stack([1.0 - w1 - w2, w1, w2], axis=1), 0.0, 1.0)
    return corners, weights / weights.sum(axis=1, keepdims=True)


@kernel
def normal_force(pull, normal):
    """Force [N] of nodal forces (k,3) against the outward normal (3)."""
    total = 0.0
    for k in range(len(pull)):
        total -= pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]
    return total


@kernel
def share_of(k, pull, normal, total):
    """Share [1] of node k in the normal force `total`; even shares where that does not press."""
    if not total > 0.0:
        return 1.0 / len(pull)
    return -(pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]) / total


def reaches(vertices: np.ndarray, within: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x, y, z [m] of each vertex and the square of the distance [m²] from the foot up to which it is told (4,N): rows
    that a processor tests several numbers of at a time; and the room for what comes of it, see `carried`.

    within [m] (N,), see `physics.geometry.graded`
    """
    rows = np.ascontiguousarray(np.concatenate([vertices.T, within[None] ** 2]))
    return rows, np.zeros(-(-len(vertices) // 8) * 8, dtype=np.uint8)


@kernel
def carried(corners, weights, u, reach, foot, told, nodes, moved):
    """Displacements of the fine mesh round a point, from those of the coarse vertices.

    corners, weights  (N,3) coarse vertices and shares of each fine vertex, see `barycentric`
    u      [m] (V,3) displacement of the coarse vertices
    reach  (4,N) see `reaches`;  foot [m] (3)
    told   (N,) uint8, room: N a multiple of 8 and zero beyond the vertices

    Fills `nodes` and `moved` [m]; returns how many.
    """
    x, y, z, square = reach[0], reach[1], reach[2], reach[3]
    for p in range(len(x)):
        d0, d1, d2 = x[p] - foot[0], y[p] - foot[1], z[p] - foot[2]
        told[p] = 0 if d0 * d0 + d1 * d1 + d2 * d2 > square[p] else 1
    count = 0
    eight = told.view(np.uint64)
    for k in range(len(eight)):
        if eight[k] == 0:
            continue
        for p in range(8 * k, 8 * k + 8):
            if told[p] == 0:
                continue
            nodes[count] = p
            for i in range(3):
                total = 0.0
                for a in range(3):
                    total += weights[p, a] * u[corners[p, a], i]
                moved[count, i] = total
            count += 1
    return count


@kernel
def add_pressure(pull, patch, normal, areas, told, push, out):
    """Add to `out` [Pa] (t,): of nodal forces (k,3) on `patch`, their part against the normal over the vertex's area,
    on the vertices `told`; `push` (N,) is room of zeros, and is left so."""
    for k in range(len(patch)):
        p = patch[k]
        force = pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]
        push[p] = -force / areas[p]
    for k in range(len(told)):
        out[k] += push[told[k]]
    for k in range(len(patch)):
        push[patch[k]] = 0.0
