"""Closed triangle surfaces that intersect themselves: their interior is not what a mesher would fill."""

from __future__ import annotations

import numpy as np

from palpate.models.fe.element.mesh import MeshError, check_closed, point_text
from palpate.physics.geometry.crossing import crossing


def check_surface(points: np.ndarray, triangles: np.ndarray) -> None:
    """MeshError: triangles (T,3) of points [m] (N,3) that are not closed, or that cross one another; says where."""
    check_closed(points, triangles)
    intersection = crossing(points, triangles)
    if intersection is not None:
        first, other, at = intersection
        raise MeshError(
            f"surface: triangles {first} and {other} cross at {point_text(at)}: it intersects itself, so that its "
            "interior is not defined. Join the parts into one surface (a union), or mesh it again"
        )
