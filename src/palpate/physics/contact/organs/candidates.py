"""The candidates of the contact of two surfaces: small opposite patches with gap, normal and area.

Vertices of the finer surface that face the other one, and are nearer to it than the reach, are gathered into cells:
each belongs to the nearest of a set of centres at least a spacing apart. The vertex with the smallest gap is the first,
and the spacing grows with the gap, up to `GRADED` times where it is the reach, so that cells are small where the
surfaces touch first. With the areas A_v of its vertices and their feet on the other surface, cell i has the weights

    P_iv = A_v/A_i,  A_i = sum of A_v in the cell

on the vertices of the finer surface and, by the barycentric weights of the feet, on those of the other. Gap, normal and
place of a cell are means with these weights, its force is spread with them, and its displacement is their mean: force
and displacement are conjugate, so that the work of the contact is that on the surfaces.
"""

from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.contact.organs.borders import Borders, borders
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.nearest import nearest, tree_of

FACING = -0.25  # [1] largest product of the normals of a vertex and of its foot
GRADED = 3.0  # [1] spacing of the centres at the reach over that at the smallest gap
WIDER = 1.1  # [1] factor on the spacing of the centres until they are few enough


class Shares(NamedTuple):
    """Weights P of m cells on the vertices of a surface, sorted by cell, then by vertex.

    cells (k), vertices (k), weights [1] (k)
    place [m] (m,3)  centre of each cell on the surface
    """

    cells: np.ndarray
    vertices: np.ndarray
    weights: np.ndarray
    place: np.ndarray


class Candidates(NamedTuple):
    """Cells of the contact of two surfaces.

    gap [m] (m), normal [1] (m,3) out of the second surface, area [m²] (m)
    first, second   shares on the vertices of each surface
    borders         between the cells
    spacing [m]     least distance of their centres where the gap is smallest
    swapped         whether the cells are those of the second surface's vertices
    deepest [m]     smallest signed distance of a vertex of one surface from the other, negative where they overlap
    """

    gap: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    first: Shares
    second: Shares
    borders: Borders
    spacing: float
    swapped: bool
    deepest: float


def candidates(first: Mesh, second: Mesh, reach: float, most: int) -> Candidates:
    """At most `most` cells where the surfaces are nearer than `reach` [m]. The arguments may be exchanged: the same
    cells in the same order, with opposite normals."""
    one, other = _near(first, second, reach), _near(second, first, reach)
    deepest = min(one.deepest, other.deepest)
    if _finer(second, other, first, one):
        found = cells(second, first, other, most)
        return found._replace(
            normal=-found.normal, first=found.second, second=found.first, swapped=True, deepest=deepest
        )
    return cells(first, second, one, most)._replace(deepest=deepest)


def nearest_distance(first: Mesh, second: Mesh, reach: float) -> float:
    """The smallest signed distance [m] of a vertex of one surface from the other, negative where they overlap; infinite
    if it is above `reach` [m]."""
    least = min(_near(first, second, reach).deepest, _near(second, first, reach).deepest)
    return least if least < reach else np.inf


class Near(NamedTuple):
    """Vertices of a surface near another, or another part of it: their indices, areas, and feet, normals, triangles and
    distances there; the smallest distance of all vertices [m], also of those that face away."""

    vertices: np.ndarray
    areas: np.ndarray
    feet: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    distances: np.ndarray
    deepest: float


def _near(mesh: Mesh, other: Mesh, reach: float) -> Near:
    low, high = other.vertices.min(axis=0) - reach, other.vertices.max(axis=0) + reach
    inside = np.flatnonzero(((mesh.vertices >= low) & (mesh.vertices <= high)).all(axis=1))
    feet, normals, triangles, distances = MeshClosestPoint(other).find(mesh.vertices[inside])
    facing = einsum("ij,ij->i", mesh.normals[inside], normals)
    keep = (distances < reach) & (facing < FACING) & (mesh.areas[inside] > 0.0)
    deepest = float(distances.min()) if len(distances) else np.inf
    return Near(
        inside[keep], mesh.areas[inside[keep]], feet[keep], normals[keep], triangles[keep], distances[keep], deepest
    )


def _finer(mesh: Mesh, near: Near, other: Mesh, others: Near) -> bool:
    """Whether the first surface has the smaller vertices near the other. Of equal ones, the place decides."""

    def key(each: Mesh, found: Near) -> tuple[float, ...]:
        if not len(found.vertices):
            return (np.inf,)
        return float(found.areas.mean()), *map(float, each.vertices[found.vertices].mean(axis=0))

    return key(mesh, near) < key(other, others)


def cells(mesh: Mesh, other: Mesh, near: Near, most: int, walls: np.ndarray | None = None) -> Candidates:
    """At most `most` cells of the vertices of a surface that are near another, each on one of the `walls` (n), numbers
    of the parts of the surface to which the vertices belong; None: all are one."""
    points = mesh.vertices[near.vertices]
    if walls is not None:  # 1 m apart
        points = np.concatenate([points, walls[:, None]], axis=1)
    order = np.argsort(near.distances, kind="stable")
    areas = near.areas
    spacing, centres = 0.0, order
    if len(order):
        out = near.distances - near.distances[order[0]]
        grown = 1.0 + (GRADED - 1.0) * out / max(float(out.max()), 1e-12)
        spacing = 0.5 * float(np.sqrt(areas.min()))
        if walls is not None:  # with less there are more than `most` on flat walls, at triangles of any size
            spacing = max(spacing, float(np.sqrt(areas.sum() / (np.pi * most))) / GRADED)
        while len(centres := _centres(points, order, spacing * grown)) > most:
            spacing *= WIDER
    count = len(centres)
    cell = nearest(tree_of(points[centres]), points)[1][:, 0] if count else np.zeros(0, np.int64)
    area = np.bincount(cell, areas, minlength=count).astype(float)
    part = areas / area[cell]
    mean = np.stack([np.bincount(cell, part * near.normals[:, i], minlength=count) for i in range(3)], axis=1) + 0.0
    normal = mean / np.sqrt(np.sum(np.square(mean), axis=1, keepdims=True))
    gap = np.bincount(cell, part * near.distances, minlength=count).astype(float)
    corners = other.triangles[near.triangles]
    weights = _barycentric(other.vertices[corners], near.feet) * part[:, None]
    own = shares_of(cell, near.vertices, part, mesh, count)
    across = shares_of(np.repeat(cell, 3), corners.ravel(), weights.ravel(), other, count)
    cell_of = np.full(len(mesh.vertices), -1)
    cell_of[near.vertices] = cell
    met = borders(mesh, cell_of, own.place, area)
    return Candidates(gap, normal, area, own, across, met, spacing, False, near.deepest)


def _centres(points: np.ndarray, order: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Indices of points chosen in this order, each without others nearer than its spacing [m] (n)."""
    free, chosen = np.ones(len(points), bool), []
    for k in order:
        if free[k]:
            chosen.append(k)
            free[np.sum(np.square(points - points[k]), axis=1) < spacing[k] * spacing[k]] = False
    return np.array(chosen, np.int64)


def _barycentric(corner: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Weights [1] (n,3) of points [m] (n,3) on triangles [m] (n,3,3)."""
    u, v, p = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], point - corner[:, 0]
    uu, uv, vv = (einsum("ij,ij->i", a, b) for a, b in ((u, u), (u, v), (v, v)))
    pu, pv = einsum("ij,ij->i", p, u), einsum("ij,ij->i", p, v)
    det = np.maximum(uu * vv - uv * uv, 1e-300)
    second, third = (vv * pu - uv * pv) / det, (uu * pv - uv * pu) / det
    weights = np.clip(np.stack([1.0 - second - third, second, third], axis=1), 0.0, None)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def shares_of(cell: np.ndarray, vertex: np.ndarray, weight: np.ndarray, mesh: Mesh, count: int) -> Shares:
    """The shares of cells on vertices, with one entry for each pair."""
    pairs, place = np.unique(np.stack([cell, vertex], axis=1), axis=0, return_inverse=True)
    weights = np.bincount(place.ravel(), weight, minlength=len(pairs)).astype(float)  # integers without a candidate
    cells, vertices = pairs[:, 0].astype(np.int64), pairs[:, 1].astype(np.int64)
    at = [np.bincount(cells, weights * mesh.vertices[vertices, i], minlength=count) for i in range(3)]
    return Shares(cells, vertices, weights, np.stack(at, axis=1).astype(float))
