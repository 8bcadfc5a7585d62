"""Stretch of a triangulated surface."""

import numpy as np

from palpate.compiler.exact import einsum


def largest_stretch(vertices: np.ndarray, triangles: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Largest principal engineering strain of each triangle against its rest shape [1] (T,).

        F = e E⁻¹,  C = FᵀF,  strain = sqrt(largest eigenvalue of C) - 1

    The columns of E (2,2) are two edges at rest in the plane of the triangle, those of e (3,2) the displaced edges. 0.1
    means that a line is 10 % longer; 0 for a rigid motion, and for a triangle without area at rest.

    vertices [m] (V,3) at rest, triangles [1] (T,3), displacement [m] (V,3)

    J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed. (2008), section 4.6.
    """
    first, second = _edges(vertices, triangles)
    length = np.linalg.norm(first, axis=1)
    along = _product(first, second) / np.where(length > 0.0, length, 1.0)
    height = np.linalg.norm(np.cross(first, second), axis=1) / np.where(length > 0.0, length, 1.0)
    flat = height <= 1e-12 * (length + np.abs(along))
    length, height = (np.where(flat, 1.0, size)[:, None] for size in (length, height))
    one, other = _edges(vertices + displacement, triangles)
    x = one / length  # the columns of F
    y = (other - along[:, None] * x) / height
    xx, xy, yy = _product(x, x), _product(x, y), _product(y, y)
    largest = (xx + yy) / 2.0 + np.sqrt(((xx - yy) / 2.0) ** 2 + xy * xy)
    return np.where(flat, 0.0, np.sqrt(largest) - 1.0)


def at_vertices(values: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Mean at each vertex (V,) of the values (T,) of its triangles, weighted by their area at rest; 0 without any."""
    area = np.linalg.norm(np.cross(*_edges(vertices, triangles)), axis=1)
    corners = triangles.ravel()
    total = np.bincount(corners, np.repeat(values * area, 3), minlength=len(vertices))
    weight = np.bincount(corners, np.repeat(area, 3), minlength=len(vertices))
    return total / np.where(weight > 0.0, weight, 1.0)


def _edges(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    origin = points[triangles[:, 0]]
    return points[triangles[:, 1]] - origin, points[triangles[:, 2]] - origin


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    return einsum("ij,ij->i", p, q)
