"""Interpolation between the coarse surface of a reduced body and the finer mesh that is touched and drawn."""

from __future__ import annotations

import numba
import numpy as np

from palpate.physics.geometry.mesh import Mesh


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


@numba.njit(cache=True)
def normal_force(pull, normal):
    """Force [N] of nodal forces (k,3) against the outward normal (3)."""
    total = 0.0
    for k in range(len(pull)):
        total -= pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]
    return total


@numba.njit(cache=True)
def share_of(k, pull, normal, total):
    """Share [1] of node k in the normal force `total`; even shares where that does not press."""
    if not total > 0.0:
        return 1.0 / len(pull)
    return -(pull[k, 0] * normal[0] + pull[k, 1] * normal[1] + pull[k, 2] * normal[2]) / total


@numba.njit(cache=True)
def carried(corners, weights, u, vertices, foot, within, nodes, moved):
    """Displacements of the fine mesh round a point, from those of the coarse vertices.

    corners, weights  (N,3) coarse vertices and shares of each fine vertex, see `barycentric`
    u         [m] (V,3) displacement of the coarse vertices
    vertices  [m] (N,3) of the fine mesh;  foot [m] (3)
    within    [m] (N,)  distance from the foot up to which each is told, see `physics.geometry.graded`

    Fills `nodes` and `moved` [m]; returns how many.
    """
    count = 0
    for p in range(len(vertices)):
        d0, d1, d2 = vertices[p, 0] - foot[0], vertices[p, 1] - foot[1], vertices[p, 2] - foot[2]
        if d0 * d0 + d1 * d1 + d2 * d2 > within[p] * within[p]:
            continue
        nodes[count] = p
        for i in range(3):
            total = 0.0
            for a in range(3):
                total += weights[p, a] * u[corners[p, a], i]
            moved[count, i] = total
        count += 1
    return count
