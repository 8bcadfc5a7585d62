"""Flips of edges that remove obtuse triangles of a mesh.

A *cap* is a triangle with an angle above 120 degrees. If its middle corner lies next to its long side, a short distance
of that corner from the true surface, such as the 25 um by which marching cubes miss an ellipsoid in voxels of 2 mm,
inclines the triangle by tens of degrees. The long side is therefore replaced by the other diagonal of the two triangles
that meet there, where their angles opposite to it have a sum above 180 degrees (the criterion of Delaunay; on surfaces:
R. Dyer, H. Zhang, T. Möller, Symposium on Geometry Processing 2007, 163-172). Vertices remain. Between 110 and 150
degrees the limit hardly matters.
"""

import numpy as np

from palpate.physics.geometry.refined.edges import CREASE, directions, edges_of, is_thin

FLAT = -0.5  # [1] cosine of the angle from which a triangle is a cap
ROUNDS = 30  # of flips of edges that have no triangle in common


def flip_caps(points: np.ndarray, triangles: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """The triangles (T,3) of points [m] (V,3) without caps; the same object if it has none.

    fixed  (K,2) ends, lower first, of edges that stay

    A cap stays at an edge of the border or of `fixed`, at one where the surface bends by more than 40 degrees, and
    where the triangles in place of it would be at an angle of more than 40 degrees to those next to it, or join twice.
    """
    for _ in range(ROUNDS):
        caps, flatness, apex = _caps(points, triangles)
        flips = _flips(points, triangles, fixed, caps, flatness, apex) if len(caps) else None
        if flips is None:
            break
        triangles = triangles.copy()
        for places, corners in flips:
            triangles[places] = corners
    return triangles


def _caps(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The caps (k) of the triangles; the cosine of their largest angle [1] and the corner where it is, 0 to 2."""
    corner = points[triangles]
    sides = [_at(corner[:, k - 2], corner[:, k], corner[:, k - 1]) for k in range(3)]
    cosines = np.stack([x / np.maximum(np.sqrt(x * x + y * y), 1e-300) for x, y in sides], 1)
    apex = cosines.argmin(axis=1)
    least = cosines[np.arange(len(apex)), apex]
    caps = np.flatnonzero(least < FLAT)
    return caps, least[caps], apex[caps]


def _flips(
    points: np.ndarray,
    triangles: np.ndarray,
    fixed: np.ndarray,
    caps: np.ndarray,
    flatness: np.ndarray,
    apex: np.ndarray,
) -> list[tuple[np.ndarray, np.ndarray]] | None:
    """Places and corners of the triangles of flips that have no triangle in common, those of the flattest caps first;
    None: no cap can be flipped."""
    count = len(points)
    ends, of, two = edges_of(triangles, count)
    c, a, b = (triangles[caps, (apex + k) % 3] for k in range(3))
    sides = [of[caps, (apex + k) % 3] for k in (1, 0, 2)]  # the long one, and those at the middle corner
    others = [two[side].sum(axis=1) - caps for side in sides]
    d = triangles[others[0]].sum(axis=1) - a - b
    keys, new = ends[:, 0] * count + ends[:, 1], np.minimum(c, d) * count + np.maximum(c, d)
    one, other = np.stack([c, a, d], 1), np.stack([c, d, b], 1)
    flat = directions(points, triangles)
    known = ~is_thin(points, triangles)
    known[caps] = False
    along, first, second = flat[others[0]], directions(points, one), directions(points, other)
    (x, y), (u, v) = _at(points[a], points[c], points[b]), _at(points[a], points[d], points[b])
    good = y * u + x * v < -1e-9 * np.abs(x * v)  # the sine of the sum of both angles
    good &= (two[sides[0], 0] != two[sides[0], 1]) & ~np.isin(new, keys)
    good &= (c != d) & ~np.isin(keys[sides[0]], fixed[:, 0] * count + fixed[:, 1])
    for pair in ((first, along), (second, along), (first, second)):
        good &= _smooth(*pair)
    for beyond in others[1:]:
        good &= ~known[beyond] | _smooth(flat[beyond], along)
    # of the flips that share a triangle or make the same edge, the flattest
    order = np.flatnonzero(good)[np.argsort(flatness[good], kind="stable")]
    order = order[np.sort(np.unique(new[order], return_index=True)[1])]
    touched, rank = np.stack([caps, *others], 1)[order], np.arange(len(order))
    best = np.full(len(triangles), len(order))
    np.minimum.at(best, touched.ravel(), np.repeat(rank, 4))
    chosen = order[(best[touched] == rank[:, None]).all(axis=1)]
    return [(caps[chosen], one[chosen]), (others[0][chosen], other[chosen])] if len(chosen) else None


def _smooth(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether the angle between unit normals (k,3) is below 40 degrees."""
    return np.asarray((one * other).sum(axis=1) > CREASE)


def _at(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of the angle (k) at b between a and c (k,3), times the lengths of both sides [m²]."""
    one, other = a - b, c - b
    return (one * other).sum(axis=1), np.linalg.norm(np.cross(one, other), axis=1)
