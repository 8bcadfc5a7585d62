"""The part of a surface that a ball cannot touch, and the distance from it."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import STACK, WAITING, MeshClosestPoint, _disc

SHORE = 1e-3  # [m] from untouchable triangles, up to which the distance is exact


class Hollow:
    """The untouchable triangles of a body; size [m]: largest distance of a corner from the middle."""

    def __init__(self, mesh: Mesh) -> None:
        corners = mesh.vertices[mesh.triangles]
        self.low, self.high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        middles = corners.mean(axis=1)
        self.size = float(np.linalg.norm(corners - middles[:, None], axis=2).max())
        self._closest = MeshClosestPoint(mesh)
        self._middles = middles[self._closest.tables.cells["origin"]]

    def about(self, points: np.ndarray, most: float) -> np.ndarray:
        """A lower bound of the distances [m] (n) of points (n,3), by less than the size of a triangle; inf if it is
        above `most` [m], which is found in less time."""
        found = np.empty(len(points))
        limit = (most + self.size) * (1.0 + 1e-9)
        _nearest(self._middles, self._closest.tables.discs, points, limit, np.empty(STACK, WAITING), found)
        return np.maximum(found - self.size, 0.0)

    def within(self, points: np.ndarray, most: float) -> np.ndarray:
        """Whether `about` is at most `most` [m] for each of the points [m] (n,3), in less time: (n,)."""
        found = np.empty(len(points), bool)
        _any_near(self._middles, self._closest.tables.discs, points, most, self.size, np.empty(STACK, np.int64), found)
        return found

    def distance(self, points: np.ndarray, most: float) -> np.ndarray:
        """Distances [m] (n) of points [m] (n,3), exact up to `SHORE`; inf above `most` [m]."""
        found = self.about(points, most)
        near = np.flatnonzero(found < SHORE)
        found[near] = distance_to(self._closest, points[near])
        return found


def distance_to(surface: MeshClosestPoint, points: np.ndarray) -> np.ndarray:
    """Distances [m] (n) of points (n,3) from a surface that may have borders."""
    return np.asarray(np.linalg.norm(points - surface.find_sorted(points)[0], axis=1))


def nearest_points(surface: MeshClosestPoint, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest points [m] (n,3) of a surface that may have borders, and their distances [m] (n)."""
    feet = surface.find_along(points)[0]
    return feet, np.asarray(np.linalg.norm(points - feet, axis=1))


@kernel
def _nearest(middles: Matrix, discs: Record, points: Matrix, limit: float, work: Record, found: Array):
    """Distances [m] (n) of points (n,3) from the nearest middle of a triangle; inf from `limit` [m] on.

    middles  [m] (T,3) of the triangles in the order of the tree;  discs  the bounds of its nodes
    """
    count, leaves, best = len(middles), len(discs) // 4, 0
    for k in range(len(points)):
        p0, p1, p2 = points[k]
        least, nearest = limit * limit, -1
        square = _square(middles[best], p0, p1, p2)  # begin at the middle that is nearest to the point before
        if square < least:
            least, nearest = square, best
        depth, work[0].node, work[0].away = 1, 1, _disc(discs[1], p0, p1, p2)
        while depth > 0:
            depth -= 1
            node = work[depth].node
            if work[depth].away >= least:
                continue
            if node < leaves:
                left, right = _disc(discs[2 * node], p0, p1, p2), _disc(discs[2 * node + 1], p0, p1, p2)
                node, near, far = (2 * node, left, right) if left <= right else (2 * node + 1, right, left)
                work[depth].node, work[depth].away = node ^ 1, far
                work[depth + 1].node, work[depth + 1].away = node, near
                depth += 2
                continue
            for t in range((node - leaves) * count // leaves, (node - leaves + 1) * count // leaves):
                square = _square(middles[t], p0, p1, p2)
                if square < least:
                    least, nearest = square, t
        found[k] = np.sqrt(least) if nearest >= 0 else np.inf
        best = max(nearest, 0)


@kernel
def _any_near(
    middles: Matrix, discs: Record, points: Matrix, most: float, size: float, work: Indices, found: Indices
):  # fmt: skip
    """Whether the distance of each of the points (n,3) from a middle of a triangle is at most `most` + `size` [m]; the
    search begins at the middle that was near the point before, and ends at the first."""
    count, leaves, best = len(middles), len(discs) // 4, 0
    limit = ((most + size) * (1.0 + 1e-9)) ** 2
    for k in range(len(points)):
        p0, p1, p2 = points[k]
        found[k] = np.sqrt(_square(middles[best], p0, p1, p2)) - size <= most
        depth, work[0] = 0 if found[k] else 1, 1
        while depth > 0:
            depth -= 1
            node = work[depth]
            if _disc(discs[node], p0, p1, p2) >= limit:
                continue
            if node < leaves:
                left = _disc(discs[2 * node], p0, p1, p2)
                near = 2 * node if left <= _disc(discs[2 * node + 1], p0, p1, p2) else 2 * node + 1
                work[depth], work[depth + 1] = 4 * node + 1 - near, near
                depth += 2
                continue
            for t in range((node - leaves) * count // leaves, (node - leaves + 1) * count // leaves):
                if np.sqrt(_square(middles[t], p0, p1, p2)) - size <= most:
                    found[k], best, depth = True, t, 0
                    break


@kernel
def _square(middle: Array, p0: float, p1: float, p2: float):
    x, y, z = p0 - middle[0], p1 - middle[1], p2 - middle[2]
    return x * x + y * y + z * z
