"""A distance on a grid, exact only where a level of it is near.

A distance changes by at most 1 m per m. So a block of points whose centre differs from the level by more than half of
its diagonal lies on one side of it, and one query is enough; others are divided in 8.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

WIDTH = 2.0  # [1] steps from the level within which the result is exact, more than the diagonal of a cell
BLOCK = 4  # points of the edge of the largest blocks; a power of 2


@dataclass(frozen=True)
class Grid:
    """Points low + step (i, j, k) [m], i, j, k < shape (3), which is divisible by `BLOCK`."""

    low: np.ndarray
    step: float
    shape: tuple[int, int, int]

    @classmethod
    def round_box(cls, low: np.ndarray, high: np.ndarray, step: float) -> "Grid":
        """A grid that covers a box [m]."""
        count = np.ceil(((high - low) / step + 1.0) / BLOCK).astype(int) * BLOCK
        return cls(low, step, (int(count[0]), int(count[1]), int(count[2])))

    def points(self, index: np.ndarray, stride: int = 1) -> np.ndarray:
        """Centres [m] (n,3) of the blocks of `stride` points with this index (n,3)."""
        return self.low + self.step * (index * stride + 0.5 * (stride - 1))


def sample(
    grid: Grid,
    distance: Callable[[np.ndarray], np.ndarray],
    level: float,
    near: Callable[[np.ndarray, float], np.ndarray],
    reach: float,
) -> np.ndarray:
    """The distance [m] on the grid, exact within `WIDTH` steps of the level, elsewhere on the right side of it.

    near   whether points (n,3) are within a distance [m] of the region of interest; blocks beyond `reach` [m] get inf
    """
    stride, root = BLOCK, np.sqrt(3.0)
    shape = tuple(n // stride for n in grid.shape)
    value, todo = np.full(shape, np.inf), np.ones(shape, bool)
    while True:
        index = np.argwhere(todo)
        points, half = grid.points(index, stride), 0.5 * root * (stride - 1) * grid.step
        inside = near(points, reach + half)
        value[tuple(index[~inside].T)] = np.inf
        index = index[inside]
        value[tuple(index.T)] = found = distance(points[inside])
        if stride == 1:
            return value
        todo = np.zeros(value.shape, bool)
        todo[tuple(index.T)] = np.abs(found - level) <= half + WIDTH * grid.step
        todo, value = (each.repeat(2, 0).repeat(2, 1).repeat(2, 2) for each in (todo, value))
        stride //= 2
