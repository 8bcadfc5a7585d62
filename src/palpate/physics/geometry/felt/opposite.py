"""The wall of a surface that is opposite a point of it, as across a cut or a fissure between two lobes."""

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

FACING = -0.5  # [1] cosine of the angle between the normals of two walls, at most: two sides of a corner are no walls
BALLS = (0.125, 0.25, 0.5, 1.0)  # [1] radii of the balls that look for the opposite wall, over the largest


def opposite(
    closest: MeshClosestPoint,
    surface: Mesh,
    points: np.ndarray,
    normals: np.ndarray,
    radius: float,
    overlap: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The nearest point [m] (n,3) of a surface to the centre of a ball that touches each of its points from outside,
    its triangle (n), -1: it does not face the point, and its distance from the tangent plane of the point [m] (n).

    radius   [m] of the largest ball; smaller ones are tried first, since near a rim the centre of a large one is nearer
             to the other side of the rim than to the wall
    overlap  [m] by which walls may cross: a mesher moves each of them
    """
    feet, other, gap = points.copy(), np.full(len(points), -1), np.zeros(len(points))
    left = np.arange(len(points))
    for share in BALLS:
        r, n = share * radius, normals[left]
        centres = points[left] + r * n
        found, _, triangles, _ = closest.find_along(centres)
        away = einsum("ni,ni->n", found - points[left], n)
        turned = einsum("ni,ni->n", unit(surface.face_vectors[triangles]), n)
        inside = np.sqrt(np.sum(np.square(found - centres), axis=1)) < r * (1.0 - 1e-3)
        faces = inside & (turned < FACING) & (away > -overlap)
        some = left[faces]
        feet[some], other[some], gap[some] = found[faces], triangles[faces], away[faces]
        left = left[~faces]
    return feet, other, gap


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (...,3) over their lengths."""
    sizes = np.sqrt(np.sum(np.square(vectors), axis=-1, keepdims=True))
    return np.asarray(vectors / np.maximum(sizes, 1e-300))
