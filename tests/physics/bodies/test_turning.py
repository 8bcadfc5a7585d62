"""Rotation vectors against scipy; centre and inertia of solids, and twist of a patch, against closed forms."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from palpate.nodes.base.surface import OnThinnedSurface
from palpate.physics.bodies.floating.solid import centre_of
from palpate.physics.bodies.floating.turning import moment_on, spin, turned, turned_back
from palpate.physics.bodies.floating.twisting import mean_radii, twist
from palpate.physics.contact.spread import kernel_values
from palpate.physics.geometry.mesh import Mesh, plane

SIZES = [0.0, 1e-9, 1e-4, 0.99e-2, 1.01e-2, 0.5, 3.0, 6.0]


@pytest.mark.parametrize("size", SIZES)
def test_a_rotation_vector_turns_as_scipy_says(size):
    rng = np.random.default_rng(1)
    axis, x = rng.normal(size=3), rng.normal(size=3)
    r = size * axis / np.linalg.norm(axis)
    np.testing.assert_allclose(turned(tuple(r), tuple(x)), Rotation.from_rotvec(r).apply(x), rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(turned_back(tuple(r), turned(tuple(r), tuple(x))), x, rtol=1e-13)


@pytest.mark.parametrize("size", SIZES)
def test_the_angular_velocity_is_that_of_the_rotation_and_moments_do_the_same_work(size):
    rng = np.random.default_rng(2)
    axis, w, torque = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    r, h = size * axis / np.linalg.norm(axis), 1e-6
    ahead, behind = Rotation.from_rotvec(r + h * w), Rotation.from_rotvec(r - h * w)
    omega = (ahead * behind.inv()).as_rotvec() / (2.0 * h)
    np.testing.assert_allclose(spin(tuple(r), tuple(w)), omega, rtol=1e-7, atol=1e-9)
    assert np.dot(moment_on(tuple(r), tuple(torque)), w) == pytest.approx(np.dot(torque, omega), rel=1e-7, abs=1e-9)


def test_centre_and_inertia_of_a_box_a_ball_and_a_plate():
    sides, at = np.array([0.02, 0.05, 0.09]), np.array([0.3, -0.2, 0.1])
    corners = at + sides * (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5)
    hull = ConvexHull(corners)
    a, b, c = (corners[hull.simplices[:, k]] for k in range(3))
    out = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3])
    triangles = np.where(out[:, None] > 0, hull.simplices, hull.simplices[:, ::-1]).astype(np.int32)
    centre, gyration = centre_of(Mesh(corners, triangles))
    np.testing.assert_allclose(centre, at, atol=1e-12)
    assert gyration**2 == pytest.approx((sides @ sides) / 18.0)  # the mean of m (b² + c²)/12 over the axes
    ball = OnThinnedSurface(surface="sphere", vertices=4000, position=(0.0, 0.0, 0.05)).whole()
    centre, gyration = centre_of(ball)
    radius = np.linalg.norm(ball.vertices - centre, axis=1).mean()
    np.testing.assert_allclose(centre, [0.0, 0.0, 0.05], atol=1e-5)
    assert gyration**2 == pytest.approx(0.4 * radius**2, rel=5e-3)
    centre, gyration = centre_of(plane(0.1, 1681))
    np.testing.assert_allclose(centre, 0.0, atol=1e-12)
    assert gyration**2 == pytest.approx(2.0 / 3.0 * 2.0 * 0.1**2 / 12.0, rel=2e-3)


def test_mean_radii_of_patches_have_closed_forms():
    """Uniform: 2/3 R and R²/2; (1 - q²)^½: 3 pi/16 R and 2/5 R²; (1 - q²)²: 16/35 R and R²/4."""
    q = (np.arange(1000) + 0.5) / 1000
    for pressure, mean, square in (
        (np.ones(1000), 2.0 / 3.0, 0.5), (kernel_values("hertz", q), 3.0 * np.pi / 16.0, 0.4),
        (kernel_values("biweight", q), 16.0 / 35.0, 0.25),
    ):  # fmt: skip
        assert mean_radii(pressure, 8e-3) == pytest.approx((mean * 8e-3, square * 64e-6), rel=1e-3)


def test_a_patch_that_twists_sticks_slips_at_its_limit_and_generates_no_energy():
    k, c, limit, dt = 0.02, 1e-4, 5e-3, 1e-3
    assert twist(0.05, 0.0, k, c, limit, dt) == pytest.approx((0.001, 0.05))
    assert twist(0.25, 1.0, k, c, limit, dt) == pytest.approx((limit, 0.25))
    rng, theta, dissipated = np.random.default_rng(4), 0.0, 0.0
    for _ in range(2000):
        rate = rng.normal(0.0, 20.0)
        moment, after = twist(theta, rate, k, c, limit, dt)
        lost = moment * rate * dt - 0.5 * k * (after**2 - theta**2)
        assert lost >= -1e-15 and abs(moment) <= limit * (1.0 + 1e-12)
        theta, dissipated = after, dissipated + lost
    assert dissipated > 1e-3
