"""The smooth foot: convergence to that of the smooth body, motion over edges, and where the nearest point remains."""

import numpy as np
import pytest
from formulas import foot_row
from numpy.testing import assert_array_equal
from pytest import approx

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint, track_mesh
from palpate.physics.geometry.phong import smooth_foot
from palpate.studies.organs.shapes import boxes, star

RADIUS = 20e-3


def feet(mesh: Mesh, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smooth and nearest feet with normals (T,6) of a path [m] (T,3)."""
    closest = MeshClosestPoint(mesh)
    arrays, (tracked, work, foot) = closest.tables.arrays, closest.scratch()
    found = np.empty((2, len(path), 6))
    for k, p in enumerate(path):
        track_mesh(*arrays, *p, 1e-4, tracked, work, foot)
        found[1, k] = foot_row(foot)[:6]
        t, v, w = smooth_foot(arrays[0], arrays[1], tracked.triangle, *foot.place, tuple(p), foot)
        found[0, k] = foot_row(foot)[:6]
        assert min(v, w) >= 0.0 and v + w <= 1.0 + 1e-12 and 0 <= t < len(mesh.triangles)
    return found[0], found[1]


def arc(depth: float, count: int = 4000) -> np.ndarray:
    """A path [m] (T,3) at a depth [m] in the ball, by 90 degrees round it."""
    a = np.linspace(0.3, 0.3 + np.pi / 2, count)
    return (RADIUS - depth) * np.stack([np.cos(a) * 0.8, np.sin(a) * 0.8, np.full(count, 0.6)], axis=1)


@pytest.mark.parametrize("depth", [-4e-3, 4e-3, 10e-3, 15e-3])
def test_in_a_ball_the_foot_is_on_the_radius_and_moves_evenly(depth):
    """The nearest point hops by h d/R. The error of the smooth one falls with the square of the edges."""
    path = arc(depth)
    errors = []
    for count in (2000, 8000):
        smooth, nearest = feet(star(lambda way: np.full(len(way), RADIUS), count), path)
        true = RADIUS * path / np.linalg.norm(path, axis=1)[:, None]
        errors.append([np.linalg.norm(each[:, :3] - true, axis=1).max() for each in (smooth, nearest)])
        even = np.linalg.norm(np.diff(true, axis=0), axis=1).max()
        step = np.linalg.norm(np.diff(smooth[:, :3], axis=0), axis=1).max()
        assert step < (1.5 if depth < 12e-3 else 6.0) * even
        away = (path - smooth[:, :3]) * -np.sign(depth)
        # the normal through p; deeper the map is singular on some triangles, and the foot nearer to the nearest point
        assert np.abs(np.cross(away, smooth[:, 3:])).max() < (1e-8 if depth < 12e-3 else 1e-5)
    assert errors[1][0] < 0.4 * errors[0][0]
    if depth > 0.0:
        assert step < 0.25 * np.linalg.norm(np.diff(nearest[:, :3], axis=0), axis=1).max()
        assert np.linalg.norm(np.diff(nearest[:, :3], axis=0), axis=1).max() > 5.0 * even
        assert errors[1][0] < 0.35 * errors[1][1]


def test_past_a_centre_of_curvature_and_at_the_edges_of_a_box_the_nearest_point_remains():
    beyond = -0.05 * arc(0.0)
    smooth, nearest = feet(star(lambda way: np.full(len(way), RADIUS), 2000), beyond + 1e-6)
    assert np.linalg.norm(smooth[:, :3], axis=1) == approx(np.linalg.norm(nearest[:, :3], axis=1), abs=1e-4)
    box = boxes(*[(-20e-3, 20e-3)] * 3, np.ones((1, 1, 1), bool), 2000)
    at = np.linspace(-25e-3, 25e-3, 500)
    smooth, nearest = feet(box, np.stack([at, np.full(500, 1e-3), np.full(500, 18e-3)], axis=1))
    near = np.abs(nearest[:, :2]).max(axis=1) > 19.99e-3  # triangles that touch an edge have other normals
    assert near.any()
    assert_array_equal(smooth[near], nearest[near])


def test_the_foot_on_a_saddle_satisfies_its_equation():
    x, y = np.meshgrid(np.linspace(-0.02, 0.02, 60), np.linspace(-0.02, 0.02, 60), indexing="ij")
    points = np.stack([x, y, 8.0 * (x**2 - y**2)], axis=-1).reshape(-1, 3)
    i = np.arange(59)[:, None] * 60 + np.arange(59)[None, :]
    mesh = Mesh(points, np.concatenate([np.stack([i, i + 60, i + 61], -1), np.stack([i, i + 61, i + 1], -1)])
                .reshape(-1, 3).astype(np.int32))  # fmt: skip
    rng = np.random.default_rng(3)
    for p in rng.uniform((-0.01, -0.01, -0.008), (0.01, 0.01, 0.008), (200, 3)):
        smooth, nearest = feet(mesh, p[None])
        r = p - smooth[0, :3]
        assert np.linalg.norm(np.cross(r, smooth[0, 3:])) < 1e-8
        assert np.linalg.norm(smooth[0, :3] - nearest[0, :3]) < 0.5e-3
