"""NURBS surfaces compared with scipy's B-splines, closed forms and finite differences."""

import numpy as np
import pytest
from formulas import outward_normal, torus
from scipy.interpolate import BSpline

from palpate.physics.geometry.nurbs import NurbsPatch
from palpate.physics.geometry.nurbs_fit import interpolate, plane_patch, sphere


def random_patch(rng, p, q, weighted=True):
    n, m = p + 4, q + 3
    knots = [
        np.concatenate([np.zeros(d + 1), np.sort(rng.uniform(0.1, 0.9, k - d - 1)), np.ones(d + 1)])
        for d, k in ((p, n), (q, m))
    ]
    weights = rng.uniform(0.5, 2.0, (n, m)) if weighted else np.ones((n, m))
    return NurbsPatch(rng.normal(size=(n, m, 3)), weights, knots[0], knots[1], p, q)


def scipy_surface(patch, u, v, du=0, dv=0):
    """The homogeneous surface (k,4) at pairs (u, v) by scipy's B-splines."""
    w = patch.weights[..., None]
    homogeneous = np.concatenate([patch.points * w, w], axis=-1)
    along = BSpline(patch.knots_u, homogeneous, patch.degree_u, axis=0)(u, nu=du)
    return np.array([BSpline(patch.knots_v, row, patch.degree_v)(y, nu=dv) for row, y in zip(along, v, strict=True)])


@pytest.mark.parametrize(("p", "q"), [(1, 1), (2, 3), (3, 3), (4, 2), (5, 6)])
def test_a_patch_and_its_derivatives_equal_those_of_scipy_splines(p, q):
    rng = np.random.default_rng(p * 10 + q)
    patch = random_patch(rng, p, q, weighted=False)
    u, v = rng.random((2, 50))
    derivatives = patch.derivatives(u, v)
    for k, (du, dv) in enumerate([(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]):
        expected = scipy_surface(patch, u, v, du, dv)[:, :3]
        np.testing.assert_allclose(derivatives[:, k], expected, atol=1e-11 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize(("p", "q"), [(2, 2), (3, 3), (3, 5)])
def test_the_derivatives_of_a_weighted_patch_satisfy_the_product_rule(p, q):
    rng = np.random.default_rng(p + q)
    patch = random_patch(rng, p, q)
    u, v = rng.random((2, 50))
    s, su, sv, suu, suv, svv = np.moveaxis(patch.derivatives(u, v), 1, 0)
    a = {k: scipy_surface(patch, u, v, *k) for k in [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]}
    w = {k: x[:, 3:] for k, x in a.items()}
    a = {k: x[:, :3] for k, x in a.items()}
    # A = w S, differentiated.
    pairs = [
        (a[0, 0], w[0, 0] * s),
        (a[1, 0], w[1, 0] * s + w[0, 0] * su),
        (a[0, 1], w[0, 1] * s + w[0, 0] * sv),
        (a[2, 0], w[2, 0] * s + 2 * w[1, 0] * su + w[0, 0] * suu),
        (a[0, 2], w[0, 2] * s + 2 * w[0, 1] * sv + w[0, 0] * svv),
        (a[1, 1], w[1, 1] * s + w[1, 0] * sv + w[0, 1] * su + w[0, 0] * suv),
    ]
    for left, right in pairs:
        np.testing.assert_allclose(left, right, atol=1e-11 * max(1.0, np.abs(left).max()))


def test_the_sphere_is_exact_and_its_normal_points_outward():
    rng = np.random.default_rng(1)
    u, v = rng.random((2, 500))
    points = sphere(0.03)(u, v)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.03, rtol=1e-14)
    np.testing.assert_allclose(outward_normal(sphere(0.03), u, v), points / 0.03, atol=1e-11)


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_the_normal_at_a_pole_is_the_limit_of_the_normals_around_it(end):
    u = np.linspace(0, 1, 37)
    axis = [0, 0, 2 * end - 1]
    np.testing.assert_allclose(outward_normal(sphere(0.02), u, np.full(37, end)), np.tile(axis, (37, 1)), atol=1e-12)


def test_the_torus_is_exact_and_its_normal_points_outward():
    rng = np.random.default_rng(2)
    u, v = rng.random((2, 500))
    x, y, z = torus(0.04, 0.013)(u, v).T
    ring = np.hypot(x, y)
    np.testing.assert_allclose((ring - 0.04) ** 2 + z**2, 0.013**2, rtol=1e-12)
    out = np.stack([(ring - 0.04) * x / ring, (ring - 0.04) * y / ring, z], axis=1) / 0.013
    np.testing.assert_allclose(outward_normal(torus(0.04, 0.013), u, v), out, atol=1e-11)


def test_the_plane_patch_is_flat_with_its_normal_up():
    patch = plane_patch(0.2)
    np.testing.assert_allclose(
        patch([0.0, 0.25, 1.0], [0.0, 0.5, 1.0]), [[-0.1, -0.1, 0], [-0.05, 0, 0], [0.1, 0.1, 0]]
    )
    np.testing.assert_allclose(outward_normal(patch, 0.3, 0.8), [0, 0, 1])


@pytest.mark.parametrize(("n", "m"), [(9, 7), (4, 4), (5, 12)])
def test_interpolation_passes_through_its_points_with_the_slopes_at_the_ends(n, m):
    rng = np.random.default_rng(5)
    grid, low, high = rng.normal(size=(n, m, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    fitted = interpolate(grid, (low, high))
    u, v = np.arange(n) / n, np.linspace(0.0, 1.0, m)
    np.testing.assert_allclose(fitted(u[:, None], v), grid, atol=1e-12)
    np.testing.assert_allclose(fitted.derivatives(u, 0.0)[:, 2], low, atol=1e-11)
    np.testing.assert_allclose(fitted.derivatives(u, 1.0)[:, 2], high, atol=1e-11)


def test_a_closed_direction_has_continuous_second_derivatives():
    grid = np.random.default_rng(4).normal(size=(10, 6, 3))
    fitted = interpolate(grid, (np.ones((10, 3)), np.zeros((10, 3))))
    v = np.linspace(0, 1, 9)
    u0, u1, *_ = fitted.domain
    before, after = fitted.derivatives(np.nextafter(u1, u0), v), fitted.derivatives(u0, v)
    np.testing.assert_allclose(before, after, atol=1e-8 * np.abs(after).max())


def test_the_error_of_a_cubic_fit_falls_with_the_fourth_power_of_the_spacing():
    def exact(u, v):
        a = 2.0 * np.pi * u
        return np.stack(np.broadcast_arrays(np.cos(a), np.sin(a), np.sin(a) * np.cos(3.6 * v)), axis=-1)

    def error(n):
        u, v = np.arange(n)[:, None] / n, np.linspace(0.0, 1.0, n)
        slopes = [
            np.stack(np.broadcast_arrays(0.0, 0.0, -3.6 * np.sin(2 * np.pi * u[:, 0]) * np.sin(3.6 * end)), axis=-1)
            for end in (0.0, 1.0)
        ]
        x, y = np.linspace(0.0, 1.0, 60)[:, None], np.linspace(0.0, 1.0, 60)
        return np.abs(interpolate(exact(u, v), tuple(slopes))(x, y) - exact(x, y)).max()

    assert np.log2(error(12) / error(24)) > 3.5


def test_a_moved_patch_moves_its_points():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    u, v = np.random.default_rng(6).random((2, 20))
    np.testing.assert_allclose(
        torus(2, 1).move(turn, (1, 2, 3))(u, v), torus(2, 1)(u, v) @ turn.T + (1, 2, 3), atol=1e-14
    )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"knots_u": np.zeros(4)}, "knots_u"),
        ({"knots_v": np.array([0, 0, 0.0, 0])}, "knots_v"),
        ({"degree_u": 3}, "degree_u"),
        ({"degree_v": 0}, "degree_v"),
        ({"weights": -np.ones((2, 2))}, "weights"),
        ({"points": np.zeros((2, 3, 3))}, "points"),
        ({"points": np.full((2, 2, 3), np.nan)}, "finite"),
    ],
)
def test_inconsistent_parts_are_errors(change, text):
    good = plane_patch(1.0)
    parts = {name: getattr(good, name) for name in ("points", "weights", "knots_u", "knots_v", "degree_u", "degree_v")}
    with pytest.raises(ValueError, match=text):
        NurbsPatch(**{**parts, **change})


def test_bad_data_points_are_errors():
    with pytest.raises(ValueError, match="at least 4"):
        interpolate(np.random.default_rng(0).normal(size=(3, 6, 3)), (np.zeros((3, 3)), np.zeros((3, 3))))
    with pytest.raises(ValueError, match="minor"):
        torus(0.01, 0.02)
