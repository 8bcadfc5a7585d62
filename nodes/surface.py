"""The undeformed surface that a scene names, for every node that needs it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from palpate.messages import Vector3
from palpate.nodes.base import SettingError
from palpate.physics.mesh import Mesh, plane

SURFACES = ("plane",)


@lru_cache(maxsize=4)
def surface_mesh(surface: str, vertices: int, position: Vector3 = (0.0, 0.0, 0.0)) -> Mesh:
    """The triangle mesh of a surface, moved to its place in the world.

    surface   name of a built-in surface
    vertices  about how many vertices a built-in surface gets
    position  [m] (3) where its origin lies

    SettingError: no such surface.
    """
    if surface == "plane":
        found = plane(0.1, vertices)
    else:
        raise SettingError(f"surface {surface!r}: unknown. Surfaces: {', '.join(SURFACES)}.")
    return Mesh(found.vertices + np.asarray(position), found.triangles)
