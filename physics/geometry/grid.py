"""A uniform grid over the vertices of a mesh, for queries whose cost does not grow with the mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel


@dataclass(frozen=True)
class Grid:
    """Vertices sorted by cell, and the triangles round each vertex.

    origin         [m] (3)    corner of the first cell
    side           [m]        of a cell
    shape          [1] (3)    number of cells along each axis
    first          [1] (C+1)  place in `order` of the first vertex of each cell, cells in C order
    order          [1] (V)    vertex indices by cell
    points         [m] (V,3)  vertices in the order of the mesh
    triangles      [1] (T,3)  the mesh's
    corners_first  [1] (V+1)  place in `corners` of the first triangle of each vertex
    corners        [1] (3T)   triangles round each vertex
    longest        [m]        longest edge of the mesh, at least `side`
    """

    origin: np.ndarray
    side: float
    shape: np.ndarray
    first: np.ndarray
    order: np.ndarray
    points: np.ndarray
    triangles: np.ndarray
    corners_first: np.ndarray
    corners: np.ndarray
    longest: float

    @staticmethod
    def of(mesh: Mesh, side: float) -> Grid:
        """The grid of a mesh with cells of `side` [m], or larger ones where these would by far outnumber the
        vertices."""
        points = np.ascontiguousarray(mesh.vertices, dtype=float)
        origin = points.min(axis=0)
        extent = points.max(axis=0) - origin
        limit = 4 * len(points) + 100_000
        while np.prod(np.floor(extent / side) + 1.0) > limit:
            side *= 1.25
        shape = (np.floor(extent / side) + 1.0).astype(np.int64)
        cell = np.minimum(((points - origin) / side).astype(np.int64), shape - 1)
        flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
        order = np.argsort(flat, kind="stable").astype(np.int32)
        triangles = np.ascontiguousarray(mesh.triangles, dtype=np.int32)
        corners = (np.argsort(triangles.ravel(), kind="stable") // 3).astype(np.int32)
        edges = points[triangles] - points[np.roll(triangles, -1, axis=1)]
        longest = float(np.sqrt(np.max(np.sum(edges * edges, axis=-1), initial=0.0)))
        return Grid(
            origin=origin,
            side=float(side),
            shape=shape,
            first=_starts(flat, int(shape.prod())),
            order=order,
            points=points,
            triangles=triangles,
            corners_first=_starts(triangles.ravel(), len(points)),
            corners=corners,
            longest=max(longest, float(side)),
        )

    def nearest(self, point: ArrayLike, normal: ArrayLike) -> tuple[int, np.ndarray]:
        """The triangle nearest to `point` [m] (3) among those that look along `normal` [1] (3), see
        `nearest_triangle`, and the barycentric coordinates [1] (3) of its nearest point."""
        hit = nearest_triangle(
            np.asarray(point, float),
            np.asarray(normal, float),
            *(self.longest, self.origin, self.side, self.shape, self.first, self.order),
            *(self.points, self.triangles, self.corners_first, self.corners),
        )
        return int(hit[0]), np.array(hit[1:])


def _starts(owner: np.ndarray, count: int) -> np.ndarray:
    """Where each owner's items start once they are sorted by owner; one more entry for the end."""
    first = np.zeros(count + 1, np.int32)
    np.cumsum(np.bincount(owner, minlength=count), out=first[1:])
    return first


@kernel(error_model="numpy")
def cell_range(point, radius, origin, side, shape):
    """First and last cell (3), (3) along each axis that a ball round `point` touches, limited to the grid.

    point, origin [m] (3)   radius, side of a cell [m]   shape (3) cells of the grid
    """
    lo = (
        _cell((point[0] - radius - origin[0]) / side, shape[0]),
        _cell((point[1] - radius - origin[1]) / side, shape[1]),
        _cell((point[2] - radius - origin[2]) / side, shape[2]),
    )
    hi = (
        _cell((point[0] + radius - origin[0]) / side, shape[0]),
        _cell((point[1] + radius - origin[1]) / side, shape[1]),
        _cell((point[2] + radius - origin[2]) / side, shape[2]),
    )
    return lo, hi


@kernel(error_model="numpy")
def _cell(x, count):
    # Held within the grid before it becomes an integer, which a point far away would overflow.
    return int(min(max(x, 0.0), count - 1.0))


@kernel(error_model="numpy")
def barycentric(p, a, b, c):
    """Barycentric coordinates (u, v, w) of the point of triangle abc nearest to p, and its squared distance [m²].

    By Voronoi regions (Ericson, Real-Time Collision Detection, 2005, ch. 5.1.5); a triangle without area answers as
    its nearest edge or corner.
    """
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    bb = abx * abx + aby * aby + abz * abz
    cc = acx * acx + acy * acy + acz * acz
    bc = abx * acx + aby * acy + abz * acz
    pb = apx * abx + apy * aby + apz * abz
    pc = apx * acx + apy * acy + apz * acz
    det = bb * cc - bc * bc
    u, v, w = 1.0, 0.0, 0.0
    inside = False
    if det > 1e-12 * bb * cc:
        v = (cc * pb - bc * pc) / det
        w = (bb * pc - bc * pb) / det
        u = 1.0 - v - w
        inside = u >= 0.0 and v >= 0.0 and w >= 0.0
    if not inside:
        best = math.inf
        edge = bb - 2.0 * bc + cc
        for side in range(3):
            if side == 0:
                t = min(max(pb / bb, 0.0), 1.0) if bb > 0.0 else 0.0
                nu, nv, nw = 1.0 - t, t, 0.0
            elif side == 1:
                t = min(max(pc / cc, 0.0), 1.0) if cc > 0.0 else 0.0
                nu, nv, nw = 1.0 - t, 0.0, t
            else:
                t = min(max((pc - pb - bc + bb) / edge, 0.0), 1.0) if edge > 0.0 else 0.0
                nu, nv, nw = 0.0, 1.0 - t, t
            x = apx - nv * abx - nw * acx
            y = apy - nv * aby - nw * acy
            z = apz - nv * abz - nw * acz
            square = x * x + y * y + z * z
            if square < best:
                best, u, v, w = square, nu, nv, nw
    x, y, z = apx - v * abx - w * acx, apy - v * aby - w * acy, apz - v * abz - w * acz
    return u, v, w, x * x + y * y + z * z


@kernel(error_model="numpy")
def nearest_triangle(
    point, normal, longest, origin, side, shape, first, order, points, triangles, corners_first, corners
):
    """Index of the triangle nearest to `point`, and the barycentric coordinates of its nearest point.

    All corners of a triangle lie within the mesh's longest edge of any of its points, so only triangles round the
    vertices within that reach are tried; the reach grows until no other triangle can be nearer. Triangles that look
    away from `normal` count only where there is no other. The index is -1 for a mesh without triangles.

    point [m] (3)   normal [1] (3)   longest [m] edge   origin, side, shape, first, order  the grid of the vertices
    points [m] (V,3)   triangles (T,3)   corners_first (V + 1), corners  of each vertex its triangles
    """
    if triangles.shape[0] == 0:
        return -1, 0.0, 0.0, 0.0
    reach = longest
    while True:
        best = away = -1
        least = least_away = math.inf
        u = v = w = ua = va = wa = 0.0
        lo, hi = cell_range(point, reach, origin, side, shape)
        for i in range(lo[0], hi[0] + 1):
            for j in range(lo[1], hi[1] + 1):
                row = (i * shape[1] + j) * shape[2]
                for at in range(first[row + lo[2]], first[row + hi[2] + 1]):
                    node = order[at]
                    for k in range(corners_first[node], corners_first[node + 1]):
                        t = corners[k]
                        a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
                        pu, pv, pw, square = barycentric(point, a, b, c)
                        if _faces(a, b, c, normal):
                            if square < least:
                                best, least, u, v, w = t, square, pu, pv, pw
                        elif square < least_away:
                            away, least_away, ua, va, wa = t, square, pu, pv, pw
        whole = True
        for k in range(3):
            whole = whole and lo[k] == 0 and hi[k] == shape[k] - 1
        if best >= 0 and (whole or reach >= longest + math.sqrt(least)):
            return best, u, v, w
        if whole:
            return away, ua, va, wa
        reach = max(2.0 * reach, longest + math.sqrt(least)) if best >= 0 else 2.0 * reach


@kernel(error_model="numpy")
def _faces(a, b, c, normal):
    x = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    y = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return x * normal[0] + y * normal[1] + z * normal[2] > 0.0
