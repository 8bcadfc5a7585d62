"""The point from which all of a closed surface is seen, if it is star-shaped."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from palpate.models.fe.element.mesh import MeshError
from palpate.models.fe.element.surface import check_surface
from palpate.physics.geometry.mesh import Mesh

LEAST = 1e-3
"""Volume of the tetrahedron from the point to a triangle, over their mean, from which the triangle counts as seen."""


def seen_from(surface: Mesh) -> np.ndarray | None:
    """A point [m] (3) from which every triangle of a closed surface is seen: the origin of its frame where that does,
    else the one that is farthest from the planes of all triangles (a linear programme); None: there is none.

    MeshError: a surface that is open, or whose normals point inwards.
    """
    vertices, triangles = surface.vertices, surface.triangles.astype(np.int64)
    check_surface(vertices, triangles)
    volume = np.einsum("ij,ij->", surface.face_vectors, vertices[triangles[:, 0]]) / 6.0
    if not volume > 0.0:
        raise MeshError(
            f"surface: its triangles enclose {1e6 * volume:.4g} ml, expected a positive volume: normals point inwards. "
            "Turn its triangles round"
        )
    origin = np.zeros(3)
    if _seen(surface, origin):
        return origin
    large = np.linalg.norm(surface.face_vectors, axis=1) > 0.0
    unit = surface.face_vectors[large] / np.linalg.norm(surface.face_vectors[large], axis=1, keepdims=True)
    middle, size = vertices.mean(axis=0), float(np.ptp(vertices))
    reach = np.einsum("ij,ij->i", unit, vertices[triangles[large, 0]] - middle) / size
    optimum = linprog(
        (0.0, 0.0, 0.0, -1.0), A_ub=np.column_stack([unit, np.ones(len(unit))]), b_ub=reach,
        bounds=[(-1.0, 1.0)] * 3 + [(None, 1.0)],
    )  # fmt: skip
    if optimum.status != 0:
        return None
    hub: np.ndarray = middle + size * optimum.x[:3]
    return hub if _seen(surface, hub) else None


def _seen(surface: Mesh, point: np.ndarray) -> bool:
    corner = surface.vertices[surface.triangles[:, 0]] - point
    seen = np.einsum("ij,ij->i", surface.face_vectors, corner)
    return bool((seen > LEAST * np.abs(seen).mean()).all())
