"""Tetrahedra inside any closed surface by fTetWild, for organs that are not star-shaped.

The surface is remeshed within 0.1 % of its size, with the same mean length of edges. Y. Hu, T. Schneider, B. Wang,
D. Zorin, D. Panozzo, Fast tetrahedral meshing in the wild, ACM Trans. Graph. 39 (2020) 117.
"""

from contextlib import chdir
from tempfile import TemporaryDirectory

import numpy as np

from palpate.models.fe.element.mesh import MeshError, TetMesh, quadratic, turned_out
from palpate.physics.extras import missing
from palpate.physics.geometry.mesh import Mesh


def solid(surface: Mesh) -> tuple[TetMesh, Mesh]:
    """Quadratic tetrahedra inside any closed surface, and their boundary, whose vertices are their first nodes.
    MeshError: pytetwild is not installed, or finds no tetrahedra inside."""
    try:
        from pytetwild import tetrahedralize
    except ModuleNotFoundError as error:
        what = "surface: not star-shaped (no point inside sees all of its triangles), which requires another mesher"
        raise MeshError(missing(what, error.name, "mesh")) from None
    corner = surface.vertices[surface.triangles]
    edge = float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).mean())
    middle, size = surface.vertices.mean(axis=0), float(np.ptp(surface.vertices))
    scaled, triangles = (surface.vertices - middle) / size, np.ascontiguousarray(surface.triangles, np.int32)
    with TemporaryDirectory() as folder, chdir(folder):  # it leaves a file in the current folder
        vertices, tets = tetrahedralize(scaled, triangles, edge_length_abs=edge / size, num_threads=1)[:2]
    if len(tets) == 0:
        raise MeshError("surface: found no tetrahedra inside it; does it intersect itself?")
    points, tets = middle + size * np.asarray(vertices, dtype=np.float64), np.asarray(tets, dtype=np.int64)
    tets = turned_out(points, tets)
    faces = quadratic(points, tets).faces[:, :3]
    outer = np.unique(faces)
    order = np.concatenate([outer, np.setdiff1d(np.unique(tets), outer)])
    number = np.full(len(points), -1)
    number[order] = np.arange(len(order))
    points = points[order]
    return quadratic(points, number[tets]), Mesh(points[: len(outer)].copy(), number[faces].astype(np.int32))
