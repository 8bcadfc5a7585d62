"""A tree of discs over triangles, and the tables of a mesh that the closest-point search reads.

The triangles are ordered along a Morton curve (C. Lauterbach et al., Computer Graphics Forum 28 (2009) 375-384); the
tree over them is complete, so that it needs no links: node k has the children 2k and 2k+1. A node is bounded by a flat
cylinder across the mean normal of its triangles. On a smooth surface its height falls with the square of its radius,
where a box is as high as it is wide: a point 40 mm from a mesh of 10^6 vertices then meets few leaves, not thousands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

LEAF = 4
FLAT = 1e-12
"""[1] A triangle whose area is less than this share of its longest edge squared counts as that edge."""

CORNERS, ACROSS, KIND, ORIGIN, COLUMNS = 0, 3, 6, 7, 8


@dataclass(frozen=True, eq=False)
class MeshTables:
    """A mesh made ready for searching.

    points   (V,6)  position [m] and outward unit normal of each vertex, equal positions made one
    cells    (T,8)  of each triangle in the order of the tree: three corners, the triangles across its edges (corner i
                    to i+1; -1 at a border), 0 or 1 + its longest edge where it is degenerate, its index in the mesh
    discs    (N,8)  centre, axis, radius and half height of each node; node 0 is unused, node 1 the root
    star_at  (V+1)  first place of each vertex in `star`
    star     (3T)   the triangles round each vertex
    """

    points: np.ndarray
    cells: np.ndarray
    discs: np.ndarray
    star_at: np.ndarray
    star: np.ndarray

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """In the order in which the kernels take them."""
        return self.points, self.cells, self.discs, self.star_at, self.star


def mesh_tables(vertices: np.ndarray, triangles: np.ndarray) -> MeshTables:
    """Tables of a mesh, vertices [m] (V,3) and triangles (T,3). Duplicated triangles are left out, and those that are
    but an edge of another; other degenerate ones stay as segments, without a normal. Vertices that no triangle holds do
    no harm.

    ValueError: no triangle, an index beyond the vertices, a vertex that is not finite.
    """
    vertices = np.ascontiguousarray(vertices, dtype=float)
    triangles = np.ascontiguousarray(triangles, dtype=np.int32)
    if not len(triangles):
        raise ValueError("the mesh has no triangles")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ValueError(f"a triangle names vertex {triangles.max()}, the mesh has {len(vertices)}")
    if not np.isfinite(vertices[triangles]).all():
        raise ValueError("a vertex of a triangle is not finite")
    triangles = weld(vertices)[triangles]
    keep = np.flatnonzero(~_superfluous(triangles, *_stars(triangles, len(vertices))))
    triangles = triangles[keep]
    corners = vertices[triangles]
    centre = (corners.min(axis=1) + corners.max(axis=1)) / 2
    order = np.argsort(_morton(centre, centre.min(axis=0), max(np.ptp(centre, axis=0).max(), 1e-300)), kind="stable")
    triangles = np.ascontiguousarray(triangles[order])
    star_at, star = _stars(triangles, len(vertices))
    cells = np.empty((len(triangles), COLUMNS), dtype=np.int32)
    cells[:, :3] = triangles
    cells[:, ORIGIN] = keep[order]
    points = np.zeros((len(vertices), 6))
    points[:, :3] = vertices
    _topology(points, cells, star_at, star)
    leaves = 1 << max(0, int(np.ceil(np.log2(len(triangles) / LEAF))))
    discs = np.zeros((2 * leaves, 8))
    _discs(vertices, triangles, leaves, discs)
    return MeshTables(points, cells, discs, star_at, star)


def weld(vertices: np.ndarray) -> np.ndarray:
    """For each vertex the index of one that stands for all at exactly its position (V,) int32."""
    key = vertices @ np.array([1.0, np.sqrt(2.0), np.sqrt(3.0)])
    order = np.argsort(key, kind="stable")
    inside = vertices[order]
    new = np.concatenate([[True], (inside[1:] != inside[:-1]).any(axis=1)])
    found = np.empty(len(vertices), dtype=np.int32)
    found[order] = order[new][np.cumsum(new) - 1]
    return found


def _stars(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The triangles round each vertex: first places (V+1) and triangles (3T)."""
    at = np.concatenate([[0], np.cumsum(np.bincount(triangles.ravel(), minlength=count))])
    star = np.empty(triangles.size, dtype=np.int32)
    _fill_stars(triangles, at[:-1].copy(), star)
    return at, star


@numba.njit(cache=True)
def _fill_stars(triangles, place, star):
    for t in range(len(triangles)):
        for i in range(3):
            v = triangles[t, i]
            star[place[v]] = t
            place[v] += 1


@numba.njit(cache=True)
def is_segment(triangles, t):
    """Whether a triangle has less than three different corners."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    return a == b or b == c or c == a


@numba.njit(cache=True)
def _superfluous(triangles, at, star):
    """Whether a triangle repeats an earlier one in the same sense, or is but an edge or a corner of a proper one."""
    found = np.zeros(len(triangles), dtype=np.bool_)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        flat = is_segment(triangles, t)
        other = b if b != a else c
        for k in range(at[a], at[a + 1]):
            s = star[k]
            x, y, z = triangles[s, 0], triangles[s, 1], triangles[s, 2]
            if flat:
                found[t] = found[t] or (not is_segment(triangles, s) and (x == other or y == other or z == other))
            elif s < t and (
                (x == a and y == b and z == c) or (x == b and y == c and z == a) or (x == c and y == a and z == b)
            ):
                found[t] = True
    return found


@numba.njit(cache=True)
def _morton(centre, low, size):
    """Interleaved bits of the coordinates, 21 of each."""
    found = np.empty(len(centre), dtype=np.int64)
    for t in range(len(centre)):
        code = 0
        for i in range(3):
            x = int(min((centre[t, i] - low[i]) / size, 1.0) * 2097151.0)
            for bit in range(21):
                code |= ((x >> bit) & 1) << (3 * bit + i)
        found[t] = code
    return found


@numba.njit(cache=True)
def _discs(vertices, triangles, leaves, discs):
    """Bounding discs of all nodes: centre, axis, radius, half height."""
    count = len(triangles)
    for node in range(1, 2 * leaves):
        width = leaves
        level = 1
        while 2 * level <= node:
            level *= 2
            width //= 2
        first = (node - level) * width * count // leaves
        last = (node - level + 1) * width * count // leaves
        c0 = c1 = c2 = n0 = n1 = n2 = 0.0
        for t in range(first, last):
            p, q, r = triangles[t]
            ux, uy, uz = (
                vertices[q, 0] - vertices[p, 0],
                vertices[q, 1] - vertices[p, 1],
                vertices[q, 2] - vertices[p, 2],
            )
            vx, vy, vz = (
                vertices[r, 0] - vertices[p, 0],
                vertices[r, 1] - vertices[p, 1],
                vertices[r, 2] - vertices[p, 2],
            )
            n0, n1, n2 = n0 + uy * vz - uz * vy, n1 + uz * vx - ux * vz, n2 + ux * vy - uy * vx
            c0 += vertices[p, 0] + vertices[q, 0] + vertices[r, 0]
            c1 += vertices[p, 1] + vertices[q, 1] + vertices[r, 1]
            c2 += vertices[p, 2] + vertices[q, 2] + vertices[r, 2]
        share = 1.0 / (3.0 * max(last - first, 1))
        c0, c1, c2 = c0 * share, c1 * share, c2 * share
        length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        if length > 0.0:
            n0, n1, n2 = n0 / length, n1 / length, n2 / length
        else:
            n0, n1, n2 = 0.0, 0.0, 1.0
        low, high, wide = np.inf, -np.inf, 0.0
        for t in range(first, last):
            for k in range(3):
                v = triangles[t, k]
                x, y, z = vertices[v, 0] - c0, vertices[v, 1] - c1, vertices[v, 2] - c2
                along = x * n0 + y * n1 + z * n2
                low, high = min(low, along), max(high, along)
                wide = max(wide, x * x + y * y + z * z - along * along)
        if last == first:
            low = high = 0.0
        middle = 0.5 * (low + high)
        size = abs(c0) + abs(c1) + abs(c2) + np.sqrt(wide) + high - low
        discs[node, 0], discs[node, 1], discs[node, 2] = c0 + middle * n0, c1 + middle * n1, c2 + middle * n2
        discs[node, 3], discs[node, 4], discs[node, 5] = n0, n1, n2
        # Rounding must not put a vertex outside.
        discs[node, 6] = np.sqrt(wide) + 1e-9 * size
        discs[node, 7] = 0.5 * (high - low) + 1e-12 * size


@numba.njit(cache=True)
def _topology(points, cells, star_at, star):
    """Fills in neighbours, degenerate triangles and the angle-weighted normals of the vertices."""
    for t in range(len(cells)):
        p = points[cells[t, 0], :3]
        q = points[cells[t, 1], :3]
        r = points[cells[t, 2], :3]
        e = (q - p, r - q, p - r)
        n = np.cross(e[0], -e[2])
        length = np.sqrt((n * n).sum())
        square = np.array([(x * x).sum() for x in e])
        longest = square.argmax()
        cells[t, KIND] = 1 + longest if 0.5 * length <= FLAT * square[longest] else 0
        if cells[t, KIND] == 0:
            for i in range(3):
                a, b = e[i], -e[(i + 2) % 3]
                angle = np.arctan2(length, (a * b).sum())
                for c in range(3):
                    points[cells[t, i], 3 + c] += angle * n[c] / length
        for i in range(3):
            a, b = cells[t, i], cells[t, (i + 1) % 3]
            cells[t, ACROSS + i] = -1
            for k in range(star_at[a], star_at[a + 1]):
                s = star[k]
                if s == t or is_segment(cells, s):
                    continue
                for j in range(3):
                    x, y = cells[s, j], cells[s, (j + 1) % 3]
                    if (x == b and y == a) or (x == a and y == b and cells[t, ACROSS + i] < 0):
                        cells[t, ACROSS + i] = s
    for v in range(len(points)):
        length = np.sqrt(points[v, 3] ** 2 + points[v, 4] ** 2 + points[v, 5] ** 2)
        if length > 1e-12:
            for c in range(3, 6):
                points[v, c] /= length
