"""Closest points of NURBS surfaces compared with closed forms and brute force."""

import numpy as np
import pytest
from formulas import bspline, foot_row, outward_normal, torus
from scipy.spatial import cKDTree

from palpate.physics.geometry.closest import ClosestPoint, track
from palpate.physics.geometry.kidney import kidney
from palpate.physics.geometry.newton import newton
from palpate.physics.geometry.nurbs import NurbsPatch
from palpate.physics.geometry.nurbs_fit import plane_patch, sphere


def directions(rng, count):
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def follow(closest, path, hysteresis=1e-4):
    """The results of tracking along a path (k,9): foot, normal, u, v, signed distance."""
    scratch = closest.scratch()
    feet = []
    for p in np.asarray(path, dtype=float):
        track(*closest.tables, *p, hysteresis, *scratch)
        feet.append(foot_row(scratch[3]))
    return np.array(feet)


def excess(distance, path):
    """Largest excess of the change of the distance over the motion of the point."""
    return (np.abs(np.diff(distance)) - np.linalg.norm(np.diff(path, axis=0), axis=1)).max()


def smooth_path(rng, size, steps, waves=5):
    t = np.linspace(0, 1, steps)[:, None]
    k = np.arange(1, waves + 1)
    a, b = rng.normal(size=(2, waves, 3)) * size / np.sqrt(waves)
    return np.sin(2 * np.pi * t * k) @ a + np.cos(2 * np.pi * t * k) @ b


@pytest.mark.parametrize("radius", [0.003, 0.03, 2.0])
def test_the_distance_from_an_exact_sphere_is_exact_from_centre_to_far_outside(radius):
    rng = np.random.default_rng(1)
    out = directions(rng, 2000)
    away = radius * np.concatenate([rng.uniform(0.1, 1.9, 1500), rng.uniform(1.9, 50, 500)])
    foot, normal, _, gap = ClosestPoint(sphere(radius)).find(out * away[:, None])
    assert np.abs(gap - (away - radius)).max() <= 1e-9 * max(1.0, radius)
    np.testing.assert_allclose(foot, radius * out, atol=1e-8 * radius)
    np.testing.assert_allclose(normal, out, atol=1e-7)


def test_the_distance_from_an_exact_torus_is_exact_within_90_percent_of_the_focal_distance():
    rng = np.random.default_rng(2)
    major, minor = 0.04, 0.015
    turn, tube = rng.uniform(0, 2 * np.pi, (2, 3000))
    d = rng.uniform(-0.9 * minor, 0.9 * minor, 3000)
    # Outside, the inner rim has its focus on the axis.
    rim = np.where(np.cos(tube) < 0, (major - minor) / np.maximum(-np.cos(tube), 1e-9), np.inf)
    d = np.minimum(d, 0.9 * rim)
    ring = major + (minor + d) * np.cos(tube)
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), (minor + d) * np.sin(tube)], axis=1)
    foot, normal, _, gap = ClosestPoint(torus(major, minor)).find(points)
    assert np.abs(gap - d).max() <= 1e-9
    assert np.abs(points - foot - gap[:, None] * normal).max() <= 1e-9


@pytest.mark.parametrize("name", ["kidney", "bumpy torus", "bumpy sheet"])
def test_the_closest_point_agrees_with_brute_force(name):
    rng = np.random.default_rng(3)
    if name == "kidney":
        surface = kidney()
    elif name == "bumpy torus":
        a, b = np.meshgrid(*[np.linspace(0, 2 * np.pi, 12, endpoint=False)] * 2, indexing="ij")
        tube = 0.015 + 0.004 * rng.random(a.shape)
        ring = 0.04 + tube * np.cos(b)
        surface = bspline(np.stack([ring * np.cos(a), ring * np.sin(a), tube * np.sin(b)], -1), True, True)
    else:
        x, y = np.meshgrid(*[np.linspace(-0.05, 0.05, 9)] * 2, indexing="ij")
        surface = bspline(np.stack([x, y, 0.01 * rng.random(x.shape)], -1))
    u0, u1, v0, v1 = surface.domain
    dense = surface(np.linspace(u0, u1, 500)[:, None], np.linspace(v0, v1, 500)).reshape(-1, 3)
    points = rng.uniform(-0.08, 0.08, (2500, 3))
    brute, _ = cKDTree(dense).query(points)
    foot, *_ = ClosestPoint(surface).find(points)
    distance = np.linalg.norm(points - foot, axis=1)
    assert (distance - brute).max() <= 1e-9
    assert (distance - brute).min() >= -2e-4


def test_the_connection_is_parallel_to_the_normal():
    points = np.random.default_rng(4).uniform(-0.09, 0.09, (3000, 3))
    foot, normal, _, gap = ClosestPoint(kidney()).find(points)
    across = np.linalg.norm(np.cross(points - foot, normal), axis=1)
    assert (across <= 1e-7 * np.abs(gap) + 1e-10).all()
    np.testing.assert_allclose(np.abs(gap), np.linalg.norm(points - foot, axis=1), atol=1e-10)


def test_inside_is_negative_and_outside_positive():
    closest = ClosestPoint(kidney())
    u, v = np.random.default_rng(5).random((2, 500))
    foot, normal = closest.surface(u, v), outward_normal(closest.surface, u, v)
    for d in (-2e-3, -1e-6, 1e-6, 2e-3):
        np.testing.assert_allclose(closest.find(foot + d * normal)[3], d, atol=1e-10)
    np.testing.assert_allclose(closest.find(foot)[3], 0.0, atol=1.1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_distance_never_changes_faster_than_the_point_moves(seed):
    rng = np.random.default_rng(seed)
    closest = ClosestPoint(kidney())
    path = smooth_path(rng, 0.03, 4000)
    feet = follow(closest, path)
    assert excess(feet[:, 8], path) <= 1e-9
    np.testing.assert_allclose(feet[:, 8], closest.find(path)[3], atol=1e-9)


def test_jumps_of_any_length_land_on_the_nearest_point():
    rng = np.random.default_rng(8)
    closest = ClosestPoint(kidney())
    path = rng.uniform(-0.1, 0.1, (2000, 3)) * rng.choice([0.1, 1.0, 100.0], (2000, 1))
    feet = follow(closest, path)
    np.testing.assert_allclose(feet[:, 8], closest.find(path)[3], atol=1e-9, rtol=1e-12)
    assert excess(feet[:, 8], path) <= 1e-9


@pytest.mark.parametrize("surface", [kidney(), sphere(0.03)], ids=["kidney", "sphere"])
@pytest.mark.parametrize("end", [0.0, 1.0])
@pytest.mark.parametrize("height", [4e-3, 1e-6, -2e-3])
def test_a_foot_point_crosses_a_pole_like_any_other_point(surface, end, height):
    closest = ClosestPoint(surface)
    pole, n = surface(0.0, end), outward_normal(surface, 0.0, end)
    across = np.linalg.svd(n[None])[2][1]
    for side in (across, np.cross(n, across)):
        s = np.linspace(-3e-3, 3e-3, 601)
        path = pole + height * n + s[:, None] * side
        feet = follow(closest, path)
        np.testing.assert_allclose(feet[:, 8], closest.find(path)[3], atol=1e-10)
        assert excess(feet[:, 8], path) <= 1e-10
        # 1 - d kappa > 0.6 here: the foot moves at most 1.7 times as far, and the normal rotates with it.
        assert np.linalg.norm(np.diff(feet[:, :3], axis=0), axis=1).max() < 2e-5
        assert np.linalg.norm(np.diff(feet[:, 3:6], axis=0), axis=1).max() < 5e-3


@pytest.mark.parametrize("height", [4e-3, -2e-3])
def test_the_distance_is_continuous_across_seam_and_pole(height):
    surface = kidney()
    closest = ClosestPoint(surface)
    v = np.linspace(0.05, 0.95, 30)
    foot, n = surface(0.0, v), outward_normal(surface, 0.0, v)
    side = surface.derivatives(0.0, v)[:, 1]
    side = side / np.linalg.norm(side, axis=1)[:, None]
    a = closest.find(foot + height * n + 1e-10 * side)[3]
    b = closest.find(foot + height * n - 1e-10 * side)[3]
    np.testing.assert_allclose(a, b, atol=1e-9)
    for end in (0.0, 1.0):
        pole, n = surface(0.0, end), outward_normal(surface, 0.0, end)
        across = np.linalg.svd(n[None])[2][1]
        a, b = closest.find(np.array([pole + height * n + 1e-10 * across, pole + height * n - 1e-10 * across]))[3]
        assert abs(a - b) <= 1e-9


def test_at_the_border_of_a_patch_the_foot_point_is_limited_and_the_distance_continuous():
    closest = ClosestPoint(plane_patch(0.1))
    path = np.stack([np.linspace(0.03, 0.07, 400), np.linspace(-0.08, 0.0, 400), np.full(400, 0.01)], axis=1)
    feet = follow(closest, path)
    np.testing.assert_allclose(feet[:, :2], np.clip(path[:, :2], -0.05, 0.05), atol=1e-9)
    np.testing.assert_allclose(feet[:, 8], 0.01, atol=1e-12)
    a, b = closest.find(np.array([[0.05 - 1e-10, 0, -0.003], [0.05 + 1e-10, 0, -0.003]]))[3]
    assert abs(a - b) <= 1e-9 and a == pytest.approx(-0.003)


def test_on_the_axis_of_a_sphere_and_a_torus_a_minimum_is_found():
    assert ClosestPoint(sphere(0.02)).find(np.zeros(3))[3] == pytest.approx(-0.02, abs=1e-9)
    ring = ClosestPoint(torus(0.04, 0.01))
    assert ring.find(np.zeros(3))[3] == pytest.approx(0.03, abs=1e-9)
    turn = np.linspace(0, 2 * np.pi, 20)
    tube = np.stack([0.04 * np.cos(turn), 0.04 * np.sin(turn), 0 * turn], axis=1)
    np.testing.assert_allclose(ring.find(tube)[3], -0.01, atol=1e-9)


def test_crossing_the_axis_of_a_torus_moves_the_foot_once_with_a_continuous_distance():
    closest = ClosestPoint(torus(0.04, 0.01))
    x = np.linspace(0.02, -0.02, 2001)
    path = np.stack([x, 0 * x, 0 * x], axis=1)
    feet = follow(closest, path)
    np.testing.assert_allclose(feet[:, 8], 0.03 - np.abs(x), atol=1e-9)
    assert (np.linalg.norm(np.diff(feet[:, :3], axis=0), axis=1) > 1e-3).sum() == 1


@pytest.mark.parametrize("hysteresis", [0.0, 1e-4, 5e-4])
def test_the_foot_stays_until_the_other_side_is_nearer_by_the_hysteresis(hysteresis):
    closest = ClosestPoint(kidney())
    z = np.linspace(2e-3, -2e-3, 801)
    path = np.stack([0 * z, 0 * z + 0.004, z], axis=1)
    feet = follow(closest, path, hysteresis)
    assert excess(feet[:, 8], path) <= 1e-9
    own = np.linalg.norm(path - feet[:, :3], axis=1)
    assert (own + feet[:, 8]).max() <= hysteresis + 1e-9
    jumps = np.flatnonzero(np.linalg.norm(np.diff(feet[:, :3], axis=0), axis=1) > 1e-3)
    assert len(jumps) == 1
    # Front and back are symmetric: their distances differ by 2 |z|, slightly less where the faces are inclined.
    assert z[jumps[0] + 1] >= -0.6 * hysteresis - 2e-5
    assert z[jumps[0] + 1] <= -0.5 * hysteresis + 1e-5


def test_tremor_on_the_medial_axis_does_not_change_the_branch():
    closest = ClosestPoint(kidney())
    path = np.array([0.0, 0.004, 0.0]) + np.array([0, 0, 1e-5]) * (-1.0) ** np.arange(50)[:, None]
    feet = follow(closest, path)
    assert np.linalg.norm(feet[:, :3] - feet[0, :3], axis=1).max() < 1e-3
    assert excess(feet[:, 8], path) <= 1e-9


def test_the_approach_to_the_hilum_passes_its_focus():
    closest = ClosestPoint(kidney())
    y = np.linspace(-0.15, -0.005, 3000)
    for x, z in ((0.0, 0.0), (0.004, 0.002)):
        path = np.stack([0 * y + x, y, 0 * y + z], axis=1)
        feet = follow(closest, path)
        assert excess(feet[:, 8], path) <= 1e-9
        np.testing.assert_allclose(feet[:, 8], closest.find(path)[3], atol=1e-9)
        assert feet[-1, 8] < 0 < feet[0, 8]


def test_the_foot_leaves_a_degenerate_border_in_any_direction():
    # A sphere with poles at the ends of u, where no polar steps are taken, and a patch with three sides.
    ball = sphere(0.03)
    parts = (np.swapaxes(ball.points, 0, 1)[:, ::-1].copy(), ball.weights.T[:, ::-1].copy(), ball.knots_v, ball.knots_u)
    lying = NurbsPatch(*parts, 2, 2, False, True)
    rng = np.random.default_rng(6)
    out = directions(rng, 500) * (0.2, 0.2, 1)
    out /= np.linalg.norm(out, axis=1)[:, None]
    feet = ClosestPoint(lying).find(out * 0.04)
    np.testing.assert_allclose(feet[3], 0.01, atol=1e-9)
    np.testing.assert_allclose(feet[1], out, atol=1e-7)
    x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    knots = [np.repeat([0.0, 1.0], 5), np.repeat([0.0, 1.0], 4)]
    flat = NurbsPatch(np.stack([x * y, y, 0 * y], -1) * 0.1, np.ones((5, 4)), *knots, 4, 3)
    points = rng.uniform(-0.05, 0.15, (1000, 3))
    a, b = points[:, :2].T  # the triangle 0 <= x <= y <= 0.1
    tip = np.clip((a + b) / 2, 0, 0.1)
    inside = (a >= 0) & (a <= b) & (b <= 0.1)
    edges = [(0 * a, np.clip(b, 0, 0.1)), (np.clip(a, 0, 0.1), 0 * a + 0.1), (tip, tip)]
    plane = np.where(inside, 0.0, np.min([np.hypot(a - p, b - q) for p, q in edges], axis=0))
    foot, *_ = ClosestPoint(flat).find(points)
    np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), np.hypot(plane, points[:, 2]), atol=1e-9)


def test_newton_leaves_a_farthest_point_and_a_saddle():
    surface = torus(0.04, 0.01)
    work, d = np.empty(200), np.empty((6, 3))
    for u, v in ((0.5, 0.0), (0.5, 0.5), (0.0, 0.5)):
        *_, f = newton(*surface.packed, 0.09, 0.0, 0.0, u, v, work, d)
        assert np.sqrt(f) == pytest.approx(0.04, abs=1e-9)


def test_the_hessian_is_positive_definite_exactly_where_one_minus_d_kappa_is():
    surface = kidney()
    rng = np.random.default_rng(7)
    for u, v, d in zip(rng.random(200), rng.uniform(0.1, 0.9, 200), rng.uniform(-0.03, 0.06, 200), strict=True):
        _, su, sv, suu, suv, svv = surface.derivatives(u, v)
        n = outward_normal(surface, u, v)
        first = np.array([[su @ su, su @ sv], [su @ sv, sv @ sv]])
        second = np.array([[suu @ n, suv @ n], [suv @ n, svv @ n]])  # curvature towards n is positive
        kappa = np.linalg.eigvals(np.linalg.solve(first, second)).real
        if np.abs(1 - d * kappa).min() < 1e-3:
            continue
        hessian = first - d * second
        assert (np.linalg.eigvalsh(hessian) > 0).all() == (1 - d * kappa > 0).all()


def test_points_at_any_distance_give_finite_answers():
    closest = ClosestPoint(kidney())
    points = np.array([[1e3, 0, 0], [0, -1e8, 1], [1e300, -1e300, 1e300], [1e-300, 0, 0], [0, 0, 0]])
    for array in closest.find(points):
        assert np.isfinite(array).all()
    assert closest.find(points)[3][0] == pytest.approx(1e3 - 0.055, rel=1e-9)


def test_the_same_path_gives_the_same_bytes():
    path = smooth_path(np.random.default_rng(9), 0.04, 500)
    assert follow(ClosestPoint(kidney()), path).tobytes() == follow(ClosestPoint(kidney()), path).tobytes()
