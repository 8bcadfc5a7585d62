"""Self-intersections of a mesh: contact alone is not one, for any rotation and position."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from palpate.physics.geometry import crossing as module
from palpate.physics.geometry.crossing import UncheckedError, crossing


def flat(rng):
    places = rng.random((40, 2))
    return np.column_stack([places, np.zeros(40)]), Delaunay(places).simplices


@pytest.mark.parametrize("offset", [0.0, 1.0, 1e3])
def test_a_flat_face_does_not_intersect_itself_at_any_rotation(offset):
    """Rounding moves its triangles slightly above and below one another."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        points, triangles = flat(rng)
        turned = Rotation.random(random_state=seed).apply(points) + offset * rng.normal(size=3)
        assert crossing(turned, triangles) is None


@pytest.mark.parametrize("offset", [0.0, 1.0, 1e3])
def test_a_needle_through_a_flat_face_is_found_at_its_position(offset):
    for seed in range(100):
        rng = np.random.default_rng(seed)
        points, triangles = flat(rng)
        where = points[triangles[0]].mean(axis=0)
        needle = where + np.array([[0, 0, 1e-3], [1e-4, 0, -1e-3], [0, 1e-4, -1e-3]])
        both = np.concatenate([points, needle]), np.concatenate([triangles, [[40, 41, 42]]])
        turn, shift = Rotation.random(random_state=seed), offset * rng.normal(size=3)
        first, second, at = crossing(turn.apply(both[0]) + shift, both[1])
        assert {len(triangles)} < {first, second}
        assert turn.inv().apply(at - shift) == pytest.approx(where, abs=1e-4)


def test_an_unused_vertex_does_not_matter():
    points, triangles = flat(np.random.default_rng(0))
    needle = np.array([[0.4, 0.5, 1e-2], [0.41, 0.5, -1e-2], [0.4, 0.51, -1e-2], [np.nan] * 3])
    assert crossing(np.concatenate([points, needle]), np.concatenate([triangles, [[40, 41, 42]]])) is not None


def torus(count):
    """A closed torus of 2 count² triangles."""
    u, v = np.meshgrid(*[np.linspace(0, 2 * np.pi, count, endpoint=False)] * 2, indexing="ij")
    away = 1.0 + 0.3 * np.cos(v)
    points = np.stack([away * np.cos(u), away * np.sin(u), 0.3 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(*[np.arange(count)] * 2, indexing="ij")
    a, b, c, d = (((i + x) % count * count + (j + y) % count).ravel() for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return points, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def test_one_wrong_vertex_among_many_triangles_is_found():
    points, triangles = torus(200)
    assert len(triangles) == 80_000
    assert crossing(points, triangles) is None
    points[12_345] *= (-1.03, -1.01, 0.9)  # to the other side of the ring
    first, second, at = crossing(points, triangles)
    spikes = np.flatnonzero((triangles == 12_345).any(axis=1))
    assert (first in spikes) != (second in spikes)
    for a, b, c in points[triangles[[first, second]]]:
        normal = np.cross(b - a, c - a)
        assert normal @ (at - a) == pytest.approx(0.0, abs=1e-9 * np.linalg.norm(normal))


@pytest.mark.parametrize("seed", range(3))
def test_as_an_exhaustive_search(seed):
    """Random triangles: the same answer as every edge against every triangle, by solving for the point."""
    rng = np.random.default_rng(seed)
    for size in (0.02, 0.1, 0.3):
        points = np.repeat(rng.random((40, 3)), 3, axis=0) + size * rng.normal(size=(120, 3))
        triangles = np.arange(120).reshape(-1, 3)
        a, b, c = points[triangles].transpose(1, 0, 2)
        found = False
        for k in range(3):
            p, q = points[triangles[:, k]], points[triangles[:, (k + 1) % 3]]
            for i in range(40):
                for j in np.flatnonzero(np.arange(40) != i):
                    share, u, v = np.linalg.solve(np.column_stack([p[i] - q[i], b[j] - a[j], c[j] - a[j]]), p[i] - a[j])
                    found |= 0 < share < 1 and u > 0 and v > 0 and u + v < 1
        assert (crossing(points, triangles) is not None) == found


def test_a_search_that_takes_too_long_ends(monkeypatch):
    """A fan of slivers, whose bounding boxes overlap one another."""
    angle = np.linspace(0.0, 1.5, 2000)
    points = np.concatenate([[[0.0, 0.0, 0.0]], np.column_stack([np.cos(angle), np.sin(angle), 0.1 * angle])])
    triangles = np.column_stack([np.zeros(1999, int), np.arange(1, 2000), np.arange(2, 2001)])
    assert crossing(points, triangles) is None
    monkeypatch.setattr(module, "MOST", 100_000)
    with pytest.raises(UncheckedError, match="1999 triangles, of which too many lie at the same place"):
        crossing(points, triangles)
