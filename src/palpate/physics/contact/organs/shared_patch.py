"""The felt surface of several bodies that one finger touches, and the part of its patch on each.

A finger touches the closing of the union of the bodies (`geometry.felt.bridge`): over a gap between two of them it is
held by both rims, as over a groove of one body. With the foot at x, a body b bears the part

    w_b(x) = sum_{j in b} A_j g_j k(|x_j - x|/R) / sum_j A_j g_j k(|x_j - x|/R)

of the patch: that of the weights with which `spread` distributes a force over the touchable surface of all of them. The
parts are positive, sum to 1, and change continuously with x. They are computed at the vertices of the felt surface,
whose edges are divided near two bodies, and interpolated, which keeps the sum.
"""

from typing import NamedTuple

import numpy as np

from palpate.physics.contact.spread import patch_areas, spreader
from palpate.physics.geometry.felt.bridge import close_surface
from palpate.physics.geometry.felt.hollow import distance_to
from palpate.physics.geometry.felt.touchable import divide_long_edges
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edge_list import edges_of

FINE = 0.125  # [1] of the radius: longest edge of the felt surface where two bodies are under the finger
GROWS = 1 / 3  # [1] by which edges may be longer per distance from the second body
POINTS = 0.25  # [1] of the radius: longest edge of the surface over which the weights are summed
KERNEL = "biweight"


class SharedFelt(NamedTuple):
    """The felt surface of B bodies.

    mesh       the surface that a ball can touch
    shares     [1] (V,B) part of the patch on each body, with the foot at a vertex
    away       [m] (V,B) distance of each vertex from what a ball touches of each body
    origins    (T,B) for each triangle the nearest touchable triangle of each body
    touchable  (T_b,) of each body: whether a ball touches its triangles
    area, depth, place  as in `geometry.felt.bridge.Felt`
    """

    mesh: Mesh
    shares: np.ndarray
    away: np.ndarray
    origins: np.ndarray
    touchable: list[np.ndarray]
    area: float
    depth: float
    place: np.ndarray


def near_bodies(bodies: list[Mesh], width: float) -> list[list[int]]:
    """Groups of bodies, each of which is nearer than `width` [m] to another of its group; a body far from all others
    is a separate group."""
    groups = [{k} for k in range(len(bodies))]
    for one in range(len(bodies)):
        for other in range(one):
            if groups[one] is groups[other] or not _is_near(bodies[one], bodies[other], width):
                continue
            groups[one] |= groups[other]
            for k in groups[one]:
                groups[k] = groups[one]
    return [sorted(group) for k, group in enumerate(groups) if k == min(group)]


def _is_near(one: Mesh, other: Mesh, width: float) -> bool:
    low, high = one.vertices.min(axis=0) - width, one.vertices.max(axis=0) + width
    if (other.vertices.max(axis=0) < low).any() or (other.vertices.min(axis=0) > high).any():
        return False
    fine, _ = divide_long_edges(other, width / 4.0)  # its vertices represent it
    inside = ((fine.vertices >= low) & (fine.vertices <= high)).all(axis=1)
    return bool(inside.any() and (MeshClosestPoint(one).find_along(fine.vertices[inside])[3] < width).any())


def close_bodies(bodies: list[Mesh], radius: float, given: list[Mesh] | None = None) -> SharedFelt | None:
    """The felt surface of bodies for a ball of the radius [m]; None: the ball touches all of each.

    given  the meshes of the bodies before they were refined, see `close_surface`

    MeshError: as of `close_surface`.
    """
    felt = close_surface(_together(bodies), radius, given=_together(given) if given else None)
    if felt is None:
        return None
    parts = np.split(felt.touchable, np.cumsum([len(body.triangles) for body in bodies])[:-1])
    reached = [Mesh(b.vertices, b.triangles[part]) for b, part in zip(bodies, parts, strict=True)]
    surfaces = [MeshClosestPoint(mesh) for mesh in reached]
    mesh, away = _divide(felt.mesh, surfaces, radius)
    shares = _shares(mesh, reached, away, radius)
    middles = mesh.vertices[mesh.triangles].mean(axis=1)
    origins = np.column_stack([
        np.flatnonzero(part)[surface.find_along(middles)[2]] for part, surface in zip(parts, surfaces, strict=True)
    ])  # fmt: skip
    return SharedFelt(mesh, shares, away, origins.astype(np.int32), parts, felt.area, felt.depth, felt.place)


def _together(bodies: list[Mesh]) -> Mesh:
    """One mesh of all triangles."""
    begins = np.cumsum([0, *(len(body.vertices) for body in bodies)])
    triangles = [body.triangles + begins[k] for k, body in enumerate(bodies)]
    points, corners = np.concatenate([body.vertices for body in bodies]), np.concatenate(triangles)
    return Mesh(points, np.ascontiguousarray(corners, np.int32))


def _divide(mesh: Mesh, surfaces: list[MeshClosestPoint], radius: float) -> tuple[Mesh, np.ndarray]:
    """The same surface with short edges where two bodies are near, and the distance [m] (V,B) of its vertices from
    each body."""
    points, triangles, normals = mesh.vertices, mesh.triangles.astype(np.int64), mesh.normals
    away = np.column_stack([distance_to(surface, points) for surface in surfaces])
    while True:
        ends, of, _ = edges_of(triangles, len(points))
        length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
        second = np.partition(away, 1, axis=1)[:, 1]
        most = np.maximum(FINE * radius, GROWS * (second[ends].min(axis=1) - length))
        long = length > most
        if not long.any():
            break
        number = np.full(len(ends), -1)
        number[long] = len(points) + np.arange(long.sum())
        new, out = (0.5 * (each[ends[long, 0]] + each[ends[long, 1]]) for each in (points, normals))
        out = out / np.maximum(np.linalg.norm(out, axis=1), 1e-12)[:, None]
        points, normals = np.concatenate([points, new]), np.concatenate([normals, out])
        away = np.concatenate([away, np.column_stack([distance_to(surface, new) for surface in surfaces])])
        triangles, _ = divide_triangles(triangles, number[of])
    return Mesh(points, np.ascontiguousarray(triangles, np.int32), normals), away


def _shares(mesh: Mesh, reached: list[Mesh], away: np.ndarray, radius: float) -> np.ndarray:
    """The part of the patch [1] (V,B) on each body with the foot at each vertex."""
    shares = np.zeros(away.shape)
    order = np.argsort(away, axis=1)
    rows = np.arange(len(away))
    shares[rows, order[:, 0]] = 1.0
    between = np.flatnonzero(away[rows, order[:, 1]] < radius)
    if not len(between):
        return shares
    feet, normals = np.ascontiguousarray(mesh.vertices[between]), np.ascontiguousarray(mesh.normals[between])
    areas = np.column_stack([
        patch_areas(spreader(divide_long_edges(one, POINTS * radius)[0], radius, KERNEL), feet, normals)
        for one in reached
    ])  # fmt: skip
    total = areas.sum(axis=1)
    found = total > 0.0
    shares[between[found]] = areas[found] / total[found, None]
    return shares
