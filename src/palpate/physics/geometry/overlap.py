"""How deep two surfaces lie in each other."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

STEP = 2e-3  # [m] largest distance of the tested points of a surface
MOST = 64  # largest number of parts of an edge
SAME = 1e-3  # [1] Difference of the bounds of two surfaces, over the size, up to which they lie at the same place
SAME_AREA = 0.02  # [1] largest difference of their areas
GRID = 12  # points along each axis of the box that both bodies share
NOWHERE = np.full(3, -np.inf)
ALONG = 0.99  # [1] least cosine between the normal of an open surface and the direction from its nearest point


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface that is tested against others, in its frame; an open one counts as a body below it."""

    mesh: Mesh

    @cached_property
    def is_open(self) -> bool:
        return bool((self.mesh.edges[1] == 1).any())

    @cached_property
    def closest(self) -> MeshClosestPoint:
        return MeshClosestPoint(self.mesh)

    @cached_property
    def points(self) -> np.ndarray:
        """Points [m] (n,3) of the surface, at most `STEP` apart along the edges: its vertices, and a grid on each
        triangle with longer edges."""
        corner = self.mesh.vertices[self.mesh.triangles]
        longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
        parts = np.minimum(np.ceil(longest / STEP).astype(int), MOST)
        found = [self.mesh.vertices]
        for count in np.unique(parts[parts > 1]).tolist():
            i, j = np.divmod(np.arange((count + 1) ** 2), count + 1)
            weights = np.stack([i, j, count - i - j], axis=1)[i + j <= count] / count
            found.append(einsum("pk,tkj->tpj", weights, corner[parts == count]).reshape(-1, 3))
        return np.concatenate(found)


class Solid(NamedTuple):
    """A shape in the world: its point x is at turn x + shift; turn (3,3), shift (3) [m]."""

    shape: Shape
    turn: np.ndarray
    shift: np.ndarray

    def out(self, points: np.ndarray) -> np.ndarray:
        """Points [m] (n,3) of its frame, in the world."""
        return np.asarray(einsum("ik,nk->ni", self.turn, points)) + self.shift

    def into(self, points: np.ndarray) -> np.ndarray:
        """Points [m] (n,3) of the world, in its frame."""
        return np.asarray(einsum("ki,nk->ni", self.turn, points - self.shift))

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (3) [m] of the body in the world; an open surface has no end below it."""
        points = self.out(self.shape.mesh.vertices)
        return (points.min(axis=0), points.max(axis=0)) if not self.shape.is_open else (NOWHERE, -NOWHERE)

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Depth [m] (n) of points (n,3) of the world below the surface; 0 or less outside, and beyond the border of an
        open surface."""
        low, high = self.box()
        depths = np.zeros(len(points))
        near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        if len(near):
            inside = self.into(points[near])
            feet, normals, _, signed = self.shape.closest.find(inside)
            if self.shape.is_open:
                along = einsum("ij,ij->i", inside - feet, normals)
                signed = np.where(np.abs(along) >= ALONG * np.linalg.norm(inside - feet, axis=1), signed, 0.0)
            depths[near] = -signed
        return depths


def coincide(one: Solid, other: Solid) -> bool:
    """Whether two surfaces have the same size and the same place."""
    first, second = (solid.out(solid.shape.mesh.vertices) for solid in (one, other))
    size = float(np.ptp(first, axis=0).max())
    ends = [np.abs(end(first, axis=0) - end(second, axis=0)).max() for end in (np.min, np.max)]
    areas = [float(solid.shape.mesh.areas.sum()) for solid in (one, other)]
    return bool(max(ends) < SAME * size and abs(areas[0] / areas[1] - 1.0) < SAME_AREA)


def overlap(one: Solid, other: Solid) -> tuple[float, np.ndarray]:
    """Thickness [m] of the part that two bodies share, and its deepest point (3) in the world; 0 and NaN if none.

    It is the greater of two lower bounds: the greatest depth of a surface point of one body below the other surface,
    with points at most `STEP` apart, and twice the least distance of a point of a grid in both bodies to the surfaces,
    which also finds bodies that nearly coincide. The first is too small by up to STEP^2/(8 r) at a radius of curvature
    r, the second by up to sqrt(3) of the step of the grid.
    """
    return max(_below(one, other), _below(other, one), _within(one, other), key=lambda found: found[0])


def _below(one: Solid, other: Solid) -> tuple[float, np.ndarray]:
    """The greatest depth [m] of a point of the surface of `one` below that of `other`, and the point (3)."""
    points = one.out(one.shape.points)
    return _deepest(other.depth(points), points)


def _within(one: Solid, other: Solid) -> tuple[float, np.ndarray]:
    """Twice the greatest distance [m] of a point of a grid in both bodies to the surfaces, and the point (3)."""
    boxes = [solid.box() for solid in (one, other)]
    low, high = np.max([box[0] for box in boxes], axis=0), np.min([box[1] for box in boxes], axis=0)
    if not (low < high).all():
        return _deepest(np.zeros(0), np.zeros((0, 3)))
    steps = [low[i] + (high[i] - low[i]) * (np.arange(GRID) + 0.5) / GRID for i in range(3)]
    points = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return _deepest(2.0 * np.minimum(one.depth(points), other.depth(points)), points)


def _deepest(depths: np.ndarray, points: np.ndarray) -> tuple[float, np.ndarray]:
    at = int(depths.argmax()) if len(depths) else -1
    return (float(depths[at]), points[at]) if at >= 0 and depths[at] > 0.0 else (0.0, np.full(3, np.nan))
