"""Height of a surface above points of the horizontal plane."""

import numpy as np

from palpate.physics.geometry.mesh import Mesh


def heights(mesh: Mesh, places: np.ndarray) -> np.ndarray:
    """Height z [m] (n) of the highest point of a mesh above each place (x, y) [m] (n,2); NaN outside the mesh."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    low, high = np.minimum(np.minimum(a, b), c)[:, :2], np.maximum(np.maximum(a, b), c)[:, :2]
    found = np.full(len(places), np.nan)
    for i, place in enumerate(places):
        near = np.flatnonzero(((low <= place) & (place <= high)).all(axis=1))
        weights = np.stack([_turn(u[near], v[near], place) for u, v in ((b, c), (c, a), (a, b))])
        twice = weights.sum(axis=0)  # signed area of the projection
        over = (weights * np.sign(twice) >= -1e-12 * np.abs(twice)).all(axis=0) & (twice != 0.0)
        if over.any():
            z = np.stack([p[near, 2] for p in (a, b, c)])
            found[i] = ((weights * z).sum(axis=0)[over] / twice[over]).max()
    return found


def _turn(u: np.ndarray, v: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Twice the projected area of the triangles of two corners (n,3) and a place (2); > 0 if counter-clockwise."""
    p, q = u[:, :2] - place, v[:, :2] - place
    return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])


def summit(mesh: Mesh, radius: float) -> np.ndarray:
    """The highest vertex [m] (3) on which a finger of this radius [m] fits: on a circle of this radius round it, the
    surface is lower or higher by less than the radius. The highest vertex of all if it fits on none."""
    order = np.argsort(-mesh.vertices[:, 2], kind="stable")
    angle = np.arange(8) * np.pi / 4
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    left = np.ones(len(order), dtype=bool)
    for v in order:
        if not left[v]:
            continue
        point = mesh.vertices[v]
        around = heights(mesh, point[:2] + ring)
        if (np.abs(around - point[2]) < radius).all():
            return np.asarray(point)
        left &= np.linalg.norm(mesh.vertices - point, axis=1) > 0.25 * radius
    return np.asarray(mesh.vertices[order[0]])
