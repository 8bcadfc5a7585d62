"""Untouchable triangles that are ripples of a tessellation, not hollows of the body.

A ball of any radius touches every point of a convex body. But where a coarse mesh is divided on a smooth surface
(`geometry.refined`), this surface has ripples: on an ellipsoid of 756 triangles they are up to 1 mm deep, and bend more
than a finger. Scatter of vertices makes them as well, a few 10 um deep. A bridge over a ripple changes the force by no
more than the tessellation does, and one over each of hundreds of ripples takes a minute.

Connected untouchable triangles are a hollow of the body if one of them is

1. untouchable on the mesh before the division as well: a part of that mesh is within r of x + r n, x being its point
   nearest to the middle of the triangle, and n the normal of its triangle there. No part of a convex mesh is;
2. deeper than `SHALLOW`: its middle is not within this distance, along its normal, of a ball that avoids the body.

A ball that is tangent to one side of a ripple overlaps the other side by about r (1 - cos θ), θ the angle between both.
So the normals of a ripple that is left as it is tilt by at most (2 SHALLOW/r)^½, 9 degrees for r = 8 mm. The walls of a
cut of any width face each other, and are as deep as the ball.
"""

import numpy as np

from palpate.physics.geometry.felt.in_ball import SLACK
from palpate.physics.geometry.felt.touchable import hides
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.pieces import pieces
from palpate.physics.geometry.search.morton import order_of

SHALLOW = 1e-4
"""[m] Up to which a hollow is a ripple: the hysteresis of a foot point, twice the error of a bridge."""
FIRST = 8  # triangles of connected ones that are tested first


def in_hollows(fine: Mesh, some: np.ndarray, deep: np.ndarray, given: Mesh, radius: float) -> np.ndarray:
    """Whether each of some untouchable triangles (n,) of a mesh is in a hollow of the body.

    deep (n,) by `are_deep`;  given  the mesh of the file
    """
    middle = fine.vertices[fine.triangles[some]].mean(axis=1)
    label = pieces(fine.triangles[some], len(fine.vertices))
    found, before = np.zeros(int(label.max()) + 1, bool), MeshClosestPoint(given)
    first = _spread_over(label)
    for part in (first, ~first):  # most hollows are found by a few of their triangles
        left = np.flatnonzero(part & deep & ~found[label])
        found[label[left[_hidden_before(middle[left], before, radius)]]] = True
    return np.asarray(found[label])


def are_deep(fine: Mesh, some: np.ndarray, body: MeshClosestPoint, radius: float) -> np.ndarray:
    """Whether the middle of each of some triangles (n,) of a mesh is not within `SHALLOW`, along its normal, of a ball
    of the radius [m] that avoids the body."""
    vector = fine.face_vectors[some]
    normal = vector / np.linalg.norm(vector, axis=1)[:, None]
    middle = fine.vertices[fine.triangles[some]].mean(axis=1)
    return hides(body, middle, normal, radius + SHALLOW, SHALLOW + SLACK)


def _spread_over(label: np.ndarray) -> np.ndarray:
    """Which members (n) of groups with these labels (n) are about `FIRST` of each, spread over their order."""
    order, size = order_of(label), np.bincount(label)
    rank = np.empty(len(label), np.int64)
    rank[order] = np.arange(len(label)) - np.repeat(np.cumsum(size) - size, size)
    return np.asarray(rank % -(-size // FIRST)[label] == 0)


def _hidden_before(points: np.ndarray, given: MeshClosestPoint, radius: float) -> np.ndarray:
    """Whether a ball cannot touch the mesh `given` next to each point [m] (n,3); nor where that has no normal."""
    if not len(points):
        return np.zeros(0, bool)
    foot, _, nearest, _ = given.find_sorted(points)
    vector = given.mesh.face_vectors[nearest]
    length = np.linalg.norm(vector, axis=1)
    hidden = length == 0.0
    facing = np.flatnonzero(~hidden)
    hidden[facing] = hides(given, foot[facing], vector[facing] / length[facing, None], radius)
    return np.asarray(hidden)
