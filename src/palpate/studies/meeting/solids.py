"""The solids that meet: each is the image of the cube -1 ... 1, whose side z = 1 becomes its top.

The middle of the top is the origin, with its outward normal along z; x = 0 and y = 0 are planes of symmetry. An elastic
foundation supports a solid where its normal points down (z below `DOWN`), as `models.fe.meshing.organ` does.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.physics.geometry.mesh import Mesh

DOWN = -0.5  # [1] As of `models.fe.meshing.organ`
BALL = 21e-3  # [m] Radius of the ball and of the cylinder: that of `surface: sphere`
HALF = 50e-3  # [m] Half side of the slab, 40 mm thick: those of `surface: plane`
THICK = 40e-3
CYLINDER = 40e-3  # [m] Half length
BOWL, DEEP = 42e-3, 15e-3  # [m] Radius at the bottom of the bowl, and its depth far from it
BLOCK, HIGH = 12e-3, 20e-3  # [m] Half side of the block, and its height
WARP = 0.13  # [1] Shift of the vertices of `surface` from a regular grid, so that no vertex is on a plane of symmetry


@dataclass(frozen=True)
class Solid:
    """One solid.

    place      points [m] (n,3) for points (n,3) of the cube
    built_in   name of the same surface in `nodes.base.surface`, or ""
    """

    name: str
    place: Callable[[np.ndarray], np.ndarray]
    built_in: str = ""

    def surface(self, count: int) -> Mesh:
        """Triangles on the surface, with `count` edges along each edge of the cube, on a grid that is not symmetric."""
        line = np.linspace(-1.0, 1.0, count + 1)
        u, v = (a.ravel() for a in np.meshgrid(line, line, indexing="ij"))
        square = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
        corners = [square[:-1, :-1], square[1:, :-1], square[1:, 1:], square[:-1, 1:]]
        a, b, c, d = (each.ravel() for each in corners)
        triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
        points, every = list[np.ndarray](), list[np.ndarray]()
        for axis in range(3):
            for side in (-1.0, 1.0):
                at = np.empty((len(u), 3))
                at[:, axis], at[:, (axis + 1) % 3], at[:, (axis + 2) % 3] = side, u, v
                every.append((triangles if side > 0.0 else triangles[:, ::-1]) + len(u) * len(points))
                points.append(at)
        cube, index = np.unique(np.concatenate(points), axis=0, return_inverse=True)
        bend = (1.0 - cube**2) * WARP  # keeps edges of the cube on themselves
        warped = cube + bend * np.array((1.0, 0.7, -0.5)) * (1.0 + 0.3 * np.roll(cube, 1, axis=1))
        return Mesh(self.place(warped), index.ravel()[np.concatenate(every)].astype(np.int32))


def _ball(cube: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(cube**2, -1, 0)
    rest = [1 - y / 2 - z / 2 + y * z / 3, 1 - x / 2 - z / 2 + x * z / 3, 1 - x / 2 - y / 2 + x * y / 3]
    return np.asarray(BALL * cube * np.sqrt(np.stack(rest, axis=-1)) - (0.0, 0.0, BALL))


def _cylinder(cube: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(cube, -1, 0)
    across, up = y * np.sqrt(1 - z * z / 2), z * np.sqrt(1 - y * y / 2)
    return np.stack([CYLINDER * x, BALL * across, BALL * (up - 1.0)], axis=-1)


def _slab(cube: np.ndarray) -> np.ndarray:
    return np.asarray((cube - (0.0, 0.0, 1.0)) * (HALF, HALF, 0.5 * THICK))


def _bowl(cube: np.ndarray) -> np.ndarray:
    placed = _slab(cube)
    square = placed[:, 0] ** 2 + placed[:, 1] ** 2
    placed[:, 2] += DEEP * -np.expm1(-square / (2.0 * BOWL * DEEP)) * 0.5 * (1.0 + cube[:, 2])
    return placed


def _block(cube: np.ndarray) -> np.ndarray:
    return np.asarray((cube - (0.0, 0.0, 1.0)) * (BLOCK, BLOCK, 0.5 * HIGH))


BALL_SOLID = Solid("ball", _ball, "sphere")
SLAB_SOLID = Solid("slab", _slab, "plane")
SOLIDS = {s.name: s for s in (
    BALL_SOLID, SLAB_SOLID, Solid("cylinder", _cylinder), Solid("bowl", _bowl), Solid("block", _block),
)}  # fmt: skip


@dataclass(frozen=True)
class Meeting:
    """Two solids that meet at the origin: the upper one is turned upside down.

    radius   [m] R: 1/R is the sum of the curvatures; of a block its half side
    closest  [1] largest closing of the foundations over R
    """

    title: str
    upper: str
    lower: str
    radius: float
    closest: float = 0.5

    @property
    def closings(self) -> np.ndarray:
        """Closings of the foundations [m] (L,) at which forces are compared."""
        return self.closest * self.radius * np.array([0.2, 0.4, 0.6, 0.8, 1.0])

    @property
    def widest(self) -> float:
        """Approximate largest radius of contact [m]: Hertz's, or three quarters of R."""
        return self.radius * min(float(np.sqrt(self.closest)), 0.75)


MEETINGS = {
    "balls": Meeting("two balls", "ball", "ball", BALL / 2),
    "ball-slab": Meeting("a ball on a slab", "ball", "slab", BALL, 0.4),
    "ball-bowl": Meeting("a ball in a bowl", "ball", "bowl", 1.0 / (1.0 / BALL - 1.0 / BOWL), 0.25),
    "cylinders": Meeting("two cylinders crossed", "cylinder", "cylinder", BALL, 0.3),
    "blocks": Meeting("a block on a slab", "block", "slab", BLOCK),
}
"""The ball in the bowl is closed by half the radius of the ball, a quarter of R. On a slab and of cylinders the mesh of
the reference folds above these closings."""


TURN = np.array(((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)))
"""Rotation of the upper solid: upside down, with x and y exchanged, so that cylinders cross."""
