"""Closed meshes as solids of manifold3d, whose package is an extra, for exact unions, differences and cuts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.errors import MeshError
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.pieces import pieces

if TYPE_CHECKING:
    from manifold3d import Manifold


def solid_of(points: np.ndarray, triangles: np.ndarray, faces: np.ndarray | None = None, name: int = 0) -> Manifold:
    """The solid that triangles (T,3) of points [m] (V,3) enclose.

    faces  (T,) number of each triangle, by which parts of it are known in a result; the index by default
    name   of the solid in a result, from `Manifold.reserve_ids`

    ImportError: the package is missing. MeshError: they enclose no solid.
    """
    import manifold3d

    made = manifold3d.Manifold(
        manifold3d.Mesh64(
            np.ascontiguousarray(points, np.float64), np.ascontiguousarray(triangles, np.uint64),
            run_index=np.array([0, triangles.size], np.uint64), run_original_id=np.array([name], np.uint32),
            face_id=np.arange(len(triangles), dtype=np.uint64) if faces is None else faces.astype(np.uint64),
        )
    )  # fmt: skip
    if made.status() != manifold3d.Error.NoError:
        raise MeshError(f"the surface does not enclose a solid ({made.status().name})")
    return made


def mesh_of_solid(solid: Manifold) -> Mesh:
    """The surface of a solid."""
    found = solid.to_mesh64()
    return Mesh(np.asarray(found.vert_properties)[:, :3].copy(), np.asarray(found.tri_verts).astype(np.int32))


def piece_volumes(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The piece of each triangle (T,) and six times the volume [m³] of each piece, negative: the surface of a void."""
    label = pieces(triangles, len(points))
    a, b, c = np.moveaxis(points[triangles] - points.mean(axis=0), 1, 0)
    return label, np.bincount(label, einsum("ij,ij->i", a, np.cross(b, c)))
