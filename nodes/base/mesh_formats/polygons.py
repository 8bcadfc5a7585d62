"""Polygons of a mesh file as triangles.

A convex polygon is cut into a fan. Any other is cut by Manifold (E. Lalish, Apache 2.0), in its mean plane (M. E.
Newell). Manifold returns n - 2 triangles of all n corners, also of those between two sides in one line, so that the
surface stays closed. The ear clipping of mapbox_earcut was tried on 4000 random polygons: half of those with corners
in a line had triangles without area.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.physics.errors import MISUSE, PalpateError
from palpate.physics.extras import require_extra

LINE = 1e-6  # [1] Sine of the angle between two sides below which a corner is on a line
MOST_CORNERS = 10_000
"""Of a polygon that is not convex: the time of a cut grows with the square of the corners, here to 0.1 s."""
CROSSED = 1e-6  # [1] Excess of the area of the triangles over that of the polygon, above which its sides cross
BLOCK = 1 << 16  # Polygons that are compared at once


@dataclass
class FileMesh:
    """The content of a mesh file.

    vertices  in its unit (V,3)
    corners   vertices (n) of all polygons, one polygon after the other
    counts    corners of each polygon
    notes     deviations from the format, and what was left out
    cut       whether the file may be cut off, as a clause; "": it is complete
    """

    vertices: np.ndarray
    corners: np.ndarray
    counts: np.ndarray
    notes: list[str] = field(default_factory=list)
    cut: str = ""


class PolygonError(PalpateError, ValueError):
    """A polygon that cannot be cut into triangles."""

    exit_code = MISUSE


def triangulate(mesh: FileMesh) -> tuple[np.ndarray, list[str]]:
    """The triangles (T,3) int64 of all polygons, in their order, and notes. Polygons of fewer than three corners have
    none. PolygonError: too many corners, or Manifold is not installed."""
    first = np.cumsum(mesh.counts) - mesh.counts
    begin = np.cumsum(np.maximum(mesh.counts - 2, 0)) - np.maximum(mesh.counts - 2, 0)
    triangles = np.empty((int(np.maximum(mesh.counts - 2, 0).sum()), 3), dtype=np.int64)
    order = np.argsort(mesh.counts, kind="stable")
    ends = np.flatnonzero(np.diff(mesh.counts[order], append=-1))
    crossed = start = 0
    for end in (ends + 1).tolist():
        members, start = order[start:end], end
        count = int(mesh.counts[members[0]])
        for block in range(0, len(members) if count > 2 else 0, max(1, BLOCK // count)):
            some = members[block : block + max(1, BLOCK // count)]
            polygons = mesh.corners[first[some][:, None] + np.arange(count)]
            steps = np.arange(1, count - 1)
            place = begin[some][:, None] + np.arange(count - 2)
            triangles[place, 0] = polygons[:, :1]
            triangles[place, 1], triangles[place, 2] = polygons[:, steps], polygons[:, steps + 1]
            if count > 3:
                points = mesh.vertices[polygons]
                for k in np.flatnonzero(~_convex(points)).tolist():
                    found, folded = _cut(points[k])
                    triangles[place[k]] = polygons[k][found]
                    crossed += folded
    few = int((mesh.counts < 3).sum())
    notes = [f"{few} of its {len(mesh.counts)} faces have fewer than three corners and are left out"] * bool(few)
    return triangles, notes + [f"the sides of {crossed} of its {len(mesh.counts)} polygons cross"] * bool(crossed)


def _convex(points: np.ndarray) -> np.ndarray:
    """Whether the fan of each polygon (m,n,3) from its first corner cuts it: all corners turn the same way, none is
    on a line. True for polygons without an area or with coordinates that are not finite, which no cut improves."""
    from palpate.compiler.exact import einsum  # imports numba, which a file of triangles does not need

    arms = points - points[:, :1]
    fan = np.cross(arms[:, 1:-1], arms[:, 2:])  # twice the area vectors of the triangles
    normal = fan.sum(axis=1)
    sides = np.roll(points, -1, axis=1) - points
    turn = np.cross(np.roll(sides, 1, axis=1), sides)
    length = np.sqrt(einsum("mni,mni->mn", sides, sides))
    size = np.sqrt(einsum("mi,mi->m", normal, normal))[:, None]
    straight = einsum("mni,mi->mn", turn, normal) > LINE * size * length * np.roll(length, 1, axis=1)
    inside = einsum("mni,mi->mn", fan, normal) > 0.0
    return (straight.all(axis=1) & inside.all(axis=1)) | ~(size[:, 0] > 0.0) | ~np.isfinite(size[:, 0])


def _cut(points: np.ndarray) -> tuple[np.ndarray, bool]:
    """The triangles (n-2,3) of a polygon (n,3), and whether its sides cross."""
    with require_extra("a polygon that is not convex", "mesh", PolygonError):
        from manifold3d import triangulate as cut
    count = len(points)
    if count > MOST_CORNERS:
        raise PolygonError(f"a polygon that is not convex has {count} corners, expected at most {MOST_CORNERS}")
    arms = points - points[0]
    normal = np.cross(arms[1:-1], arms[2:]).sum(axis=0)
    drop = int(np.abs(normal).argmax())  # seen along this axis, collinear corners stay collinear without rounding
    seen = np.roll(np.delete(arms, drop, axis=1), drop == 1, axis=1)
    order = np.arange(count) if normal[drop] > 0.0 else np.arange(count)[::-1]
    library: Any = cut
    found = order[np.asarray(library([np.ascontiguousarray(seen[order])]), dtype=np.int64)]
    if len(found) != count - 2:  # repeated corners
        found = np.stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    found = found if normal[drop] > 0.0 else found[:, ::-1]
    areas = np.abs(_areas(seen, found))
    return found, bool(areas.sum() > (1.0 + CROSSED) * 0.5 * abs(normal[drop]))


def _areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Signed areas (T,) of triangles in a plane, points (n,2)."""
    (ax, ay), (bx, by), (cx, cy) = (points[triangles[:, i]].T for i in range(3))
    return np.asarray(0.5 * ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)))
