"""The centres of the balls of a radius that touch a body from outside: the surface at this distance from it.

Marching cubes give it within a step of the grid. Each vertex is moved along the direction from its nearest point of the
body to the exact distance. Where a ball touches two parts of the body, this surface has a crease, which marching cubes
cut off: a bridge over a groove would be up to h w/(8r) too high, with the step h and the width w. There the edges of
triangles are divided at the point of the crease. A corridor between two walls into which the ball just fits may be
narrower than the grid: there the touchable triangles themselves are moved by the radius along their normals.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.felt.band import Grid
from palpate.physics.geometry.felt.in_ball import SLACK
from palpate.physics.geometry.felt.touchable import divide_long_edges
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.divided import divide_triangles
from palpate.physics.geometry.refined.edge_list import edges_of

ROUNDS = 12  # projections of a vertex at most
APART = 1.2  # [1] distance of the feet of two neighbours over theirs, above which a crease is between them
BESIDE = 0.25  # [1] of an edge: distance of a crease from its end below which the end is moved, not the edge divided
FARTHEST = 0.5  # [1] of the radius: from the middle of an edge to the crease
FINE = 0.05  # [1] of the radius: longest edge of a moved triangle
OFF_GRID = 0.1  # [1] of a step: distance of a known centre from the surface above which the grid has missed it
EXACT, OFF = 1e-4, 0.02  # [1] of a step: error of the distance up to which, and above which, a vertex is left out of
# further projections, and of the surface
GRAIN = 1.0 / (1 << 30)
"""[m] To which new vertices are rounded, so that processors with other last bits give the same surface."""


Find = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""The nearest points [m] (n,3) of a surface to points [m] (n,3), and their distances [m] (n)."""


def rounded(points: np.ndarray) -> np.ndarray:
    """Points [m] rounded to `GRAIN`."""
    return np.round(points / GRAIN) * GRAIN


def march(values: np.ndarray, grid: Grid, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m] (V,3) and triangles (T,3) of a level of values on a grid; normals towards larger values."""
    from skimage.measure import marching_cubes  # its package is an extra

    if not values.min() < level < values.max():
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    points, triangles, *_ = marching_cubes(values, level, gradient_direction="descent", allow_degenerate=False)
    return grid.low + grid.step * points.astype(float), triangles.astype(np.int64)


def centre_surface(
    body: MeshClosestPoint, distances: np.ndarray, grid: Grid, radius: float, touched: np.ndarray
) -> MeshClosestPoint:
    """The surface of centres near the level `radius` [m] of the distances [m] of the body on a grid.

    touched  [m] (n,3,3) corners of triangles that the ball touches, moved to its centre
    """
    points, triangles = march(np.minimum(distances, 2.0 * radius), grid, radius)

    find = partial(_signed, body)
    points, feet, error = _project(find, points, radius, grid.step)
    good = np.abs(error) < OFF * grid.step
    triangles = triangles[good[triangles].all(axis=1)]
    points, triangles = divide_creases(find, points, feet, triangles, good, radius, grid.step, APART)
    middle = touched.mean(axis=1)
    if len(triangles):
        found = MeshClosestPoint(Mesh(points, np.ascontiguousarray(triangles, np.int32)))
        touched = touched[found.beyond(middle, OFF_GRID * grid.step)]
    if len(touched):
        more, _ = divide_long_edges(
            Mesh(touched.reshape(-1, 3), np.arange(touched[..., 0].size, dtype=np.int32).reshape(-1, 3)), FINE * radius
        )
        free = body.find_sorted(more.vertices)[3] >= radius - SLACK
        triangles = np.concatenate([triangles, len(points) + more.triangles[free[more.triangles].all(axis=1)]])
        points = np.concatenate([points, more.vertices])
    return MeshClosestPoint(Mesh(rounded(points), np.ascontiguousarray(triangles, np.int32)))


def _signed(body: MeshClosestPoint, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest points [m] (n,3) of a body, and the distances [m] (n), negative inside."""
    feet, _, _, distance = body.find_along(at)
    return feet, distance


def onto_centres(
    body: MeshClosestPoint, points: np.ndarray, radius: float, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] (n,3) on facets of the surface of centres, which are chords, moved to the distance `radius` [m] from
    the body, and whether they arrived (n); step [m] of the grid."""
    points, _, error = _project(partial(_signed, body), points, radius, step)
    return points, np.abs(error) < OFF * step


def _project(find: Find, points: np.ndarray, radius: float, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [m] (n,3) moved to the distance `radius`, by at most a step in each round; their nearest points on the
    body [m] (n,3), and the error of the distance [m] (n) that is left."""
    points = points.copy()
    feet, error = np.empty_like(points), np.empty(len(points))
    left = np.arange(len(points))
    for _ in range(ROUNDS):
        foot, distance = find(points[left])
        feet[left], error[left] = foot, radius - distance
        off = np.abs(error[left]) > EXACT * step
        left, foot, distance = left[off], foot[off], distance[off]
        if not len(left):
            break
        across = (points[left] - foot) / np.maximum(np.abs(distance), 1e-12)[:, None]
        points[left] += np.clip(error[left], -step, step)[:, None] * across
    return points, feet, error


def divide_creases(
    find: Find,
    points: np.ndarray,
    feet: np.ndarray,
    triangles: np.ndarray,
    good: np.ndarray,
    radius: float,
    step: float,
    apart: float,
) -> tuple[np.ndarray, np.ndarray]:
    """A surface at the distance `radius` [m] from another one, with its edges divided where they pass over a crease.

    find  the nearest points of the other one;  points, feet [m] (V,3) of the surface and nearest to them;
    good   (V,) which of them are at this distance;  step [m] by which a new point is moved at most
    apart  [1] distance of the nearest points of two neighbours over theirs, above which a crease is between them
    """
    ends, of, _ = edges_of(triangles, len(points))
    one, other = ends.T
    between = feet[other] - feet[one]
    square = einsum("ij,ij->i", between, between)
    length = np.linalg.norm(points[other] - points[one], axis=1)
    crease = (square > (apart * length + 1e-6) ** 2) & (square < 3.9999 * radius * radius) & good[one] & good[other]
    if not crease.any():
        return points, triangles
    one, other, between, square, long = one[crease], other[crease], between[crease], square[crease], length[crease]
    # the point at the distance r from both nearest points that is nearest to the middle of the edge
    axis = between / np.sqrt(square)[:, None]
    middle, hub = 0.5 * (points[one] + points[other]), 0.5 * (feet[one] + feet[other])
    out = middle - hub
    out -= einsum("ij,ij->i", out, axis)[:, None] * axis
    length = np.linalg.norm(out, axis=1)
    top = hub + (np.sqrt(radius * radius - 0.25 * square) / np.maximum(length, 1e-12))[:, None] * out
    top, _, error = _project(find, top, radius, step)
    good = (np.abs(error) < OFF * step) & (np.linalg.norm(top - middle, axis=1) < FARTHEST * radius) & (length > 1e-6)
    points, edge = points.copy(), np.flatnonzero(crease)
    for end in (one, other):
        beside = good & (np.linalg.norm(top - points[end], axis=1) < BESIDE * long)
        points[end[beside]] = top[beside]
        good &= ~beside
    number = np.full(len(ends), -1)
    number[edge[good]] = len(points) + np.arange(good.sum())
    divided, _ = divide_triangles(triangles, number[of])
    return np.concatenate([points, top[good]]), divided
