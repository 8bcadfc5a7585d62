"""The path on the top of the shipped kidney, along which a touch strokes it.

The kidney is the image of a cube, through the ball that its shape is made from (`physics.geometry.kidney`), so that a
grid of the cube, graded towards a place, is a mesh of it. `benchmarks/references.py` solves it there.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.physics.geometry.kidney import LENGTH, THICKNESS, WIDTH, shape

FAR = 0.5  # [1] Share of the cube's half side up to which the path is told


@dataclass(frozen=True)
class Kidney:
    """Where the kidney is pressed and how finely it is cut.

    place  [m] along the path on its top, from its middle towards the upper pole
    cells  cells across the patch's radius
    """

    place: float = 0.0
    cells: int = 2


@lru_cache(maxsize=1)
def _fit() -> tuple[np.ndarray, np.ndarray]:
    """Scale [m] and offset [m] (3) that give the shape the size of the kidney, centred."""
    phi, theta = np.meshgrid(np.linspace(0.0, 2 * np.pi, 721), np.linspace(0.0, np.pi, 721))
    all_round = shape(np.stack([-np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)], axis=-1))
    low, high = all_round.min(axis=(0, 1)), all_round.max(axis=(0, 1))
    scale = np.array([LENGTH, WIDTH, THICKNESS]) / (high - low)
    return scale, -scale * (low + high) / 2


def inside(cube: np.ndarray) -> np.ndarray:
    """Points [m] (...,3) of the kidney, of points of the cube -1 ... 1 (...,3); the side z = 1 is its top."""
    square = cube**2
    a, b, c = np.moveaxis(square, -1, 0)
    rest = np.stack([1 - b / 2 - c / 2 + b * c / 3, 1 - a / 2 - c / 2 + a * c / 3, 1 - a / 2 - b / 2 + a * b / 3], -1)
    scale, offset = _fit()
    return scale * shape(cube * np.sqrt(rest)) + offset


@lru_cache(maxsize=1)
def path() -> tuple[np.ndarray, np.ndarray]:
    """Cube coordinate x, and the way [m] along the path from its middle, of the top's middle line."""
    x = np.linspace(-FAR, FAR, 4001)
    points = inside(np.stack([x, 0 * x, 0 * x + 1], axis=-1))
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    return x, way - way[len(way) // 2]


def along(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Foot points [m], outward normals and directions of the path (n,3) at places [m] (n,) along it."""
    x = np.interp(place, *path()[::-1])
    h, at = 1e-5, np.stack([x, 0 * x, 0 * x + 1], axis=-1)
    ahead, aside = ((inside(at + step) - inside(at - step)) / (2 * h) for step in ((h, 0, 0), (0, h, 0)))
    normal = np.cross(ahead, aside)
    return inside(at), _unit(normal), _unit(ahead)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
