"""The largest closing that is computed: its memory grows with the inverse of the radius of the ball.

A thin stylus, or a radius in a wrong unit, would otherwise divide the body into triangles without end. Where a closing
is too large, the finger touches the surface of the file, and a note has the width from which gaps are bridged.
"""

import numpy as np

from palpate.physics.errors import MeshError
from palpate.physics.geometry.felt.touchable import SHORT
from palpate.physics.geometry.mesh import Mesh

MOST_TRIANGLES = 1 << 21  # of a body with edges of `SHORT` radii, if they are equilateral: about 1 GB
MOST_POINTS = 1 << 27  # of the grid: 1 GB for each of its distances


def check_triangles(mesh: Mesh, radius: float) -> None:
    """MeshError: a surface has too many triangles that a ball of the radius [m] can be tested on."""
    area = 0.5 * float(np.linalg.norm(mesh.face_vectors, axis=1).sum())
    least = np.sqrt(4.0 / np.sqrt(3.0) * area / MOST_TRIANGLES) / SHORT
    _check(radius, float(least), "triangles of the surface")


def check_grid(shape: tuple[int, int, int], margin: float, radius: float) -> None:
    """MeshError: a grid for a ball of the radius [m] has too many points; `margin` of them along each axis are
    there for a ball of any radius."""
    least, inner = radius, np.maximum(np.array(shape) - margin, 0.0)
    while float(np.prod(inner * radius / least + margin)) > MOST_POINTS:
        least *= 1.01
    _check(radius, least, "points of a grid")


def _check(radius: float, least: float, what: str) -> None:
    if radius < least:
        raise MeshError(
            f"a finger of {2e3 * radius:.2g} mm needs too many {what} of this size; it is possible from about "
            f"{2e3 * least:.2g} mm on"
        )
