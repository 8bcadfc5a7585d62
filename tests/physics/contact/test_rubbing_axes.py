"""How the friction of two bodies turns with them (physics.contact.organs.rubbing_axes)."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.physics.contact.organs.rubbing_axes import add_turned, keep_turned, turn_bristles

UP = np.array([0.0, 0.0, 1.0])


def course(rotations, normals, z):
    """Bristles (n,3) along a course of rotations of two bodies (n,2,3,3) and of the normal of their patch (n,3)."""
    bristles, facing, out, found = np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(3), [np.array(z)]
    keep_turned(rotations[0], found[0], bristles)
    keep_turned(rotations[0], normals[0], facing)
    for axes, n in zip(rotations[1:], normals[1:], strict=True):
        turn_bristles(axes, bristles, facing, n, out)
        keep_turned(axes, out, bristles)
        keep_turned(axes, n, facing)
        found.append(out.copy())
    return np.array(found)


def spun(vectors):
    """Matrices (n,3,3) of rotation vectors (n,3)."""
    return Rotation.from_rotvec(vectors).as_matrix()


def test_a_rotation_of_both_bodies_turns_the_bristles_with_them():
    angles = np.linspace(0.0, 5.0, 40)[:, None] * np.array([0.48, 0.6, 0.64])
    turns, start = spun(angles), Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
    z = np.array([3e-5, -1e-5, 0.0])
    found = course(np.stack([turns, turns @ start], axis=1), turns @ UP, z)
    np.testing.assert_allclose(found, turns @ z, atol=1e-18)


def test_bristles_turn_by_the_mean_of_both_spins_about_the_normal():
    turns = np.stack([spun(np.outer(np.linspace(0.0, end, 200), UP)) for end in (2.0, -0.6)], axis=1)
    found = course(turns, np.tile(UP, (200, 1)), [2e-5, 0.0, 0.0])
    assert found[-1] == approx(2e-5 * np.array([np.cos(0.7), np.sin(0.7), 0.0]), abs=1e-18)


@pytest.mark.parametrize("first, second", [(1.0, 0.5), (3.0, 1.0), (0.4, 2.0), (1.0, 1e9)])
def test_bristles_of_balls_of_any_radii_that_roll_on_each_other_stay_along_the_surface(first, second):
    """The second is fixed: the normal turns by s/R_2, the first ball by s/R_1 + s/R_2. To first order in the step."""
    way, y = np.linspace(0.0, 1.5, 2000), np.array([0.0, 1.0, 0.0])
    normals = np.stack([np.sin(way / second), 0.0 * way, np.cos(way / second)], axis=1)
    turns = np.stack([spun(np.outer(way * (1.0 / first + 1.0 / second), y)), np.tile(np.eye(3), (2000, 1, 1))], axis=1)
    found = course(turns, normals, [1e-5, 2e-5, 0.0])
    ahead = np.cross(y, normals)
    np.testing.assert_allclose((found * normals).sum(axis=1), 0.0, atol=1e-17)
    np.testing.assert_allclose((found * ahead).sum(axis=1), 1e-5, rtol=2e-3)
    np.testing.assert_allclose(found[:, 1], 2e-5, rtol=2e-3)


@pytest.mark.parametrize("angle", [0.3, 1.0])
def test_a_closed_path_of_the_normal_turns_the_bristles_by_its_solid_angle(angle):
    """C. F. Gauss, O. Bonnet: a circle of the polar angle a encloses 2 pi (1 - cos a). Bodies that only slide."""
    at = np.linspace(0.0, 2.0 * np.pi, 4000)
    normals = np.stack([np.sin(angle) * np.cos(at), np.sin(angle) * np.sin(at), np.full(4000, np.cos(angle))], axis=1)
    south, east = np.array([np.cos(angle), 0.0, -np.sin(angle)]), np.array([0.0, 1.0, 0.0])
    found = course(np.tile(np.eye(3), (4000, 2, 1, 1)), normals, south)
    solid = 2.0 * np.pi * (1.0 - np.cos(angle))
    assert (found[-1] @ south, found[-1] @ east) == approx((np.cos(solid), np.sin(solid)), abs=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-12)


def test_any_turn_keeps_the_energy_of_the_bristles():
    """Also where the normal jumps to its opposite, or the bristles are not along the surface."""
    rng = np.random.default_rng(4)
    for _ in range(300):
        turns = spun(rng.normal(0.0, 0.5, (4, 3))).reshape(2, 2, 3, 3)
        n = rng.normal(size=(2, 3))
        n /= np.linalg.norm(n, axis=1)[:, None]
        z = rng.normal(size=3)
        assert np.linalg.norm(course(turns, n, z)[-1]) == approx(np.linalg.norm(z), rel=1e-12)
    still = np.tile(np.eye(3), (2, 2, 1, 1))
    assert course(still, np.array([UP, -UP]), [1.0, 2.0, 3.0])[-1] == approx([-1.0, -2.0, -3.0])


def test_a_turn_by_180_degrees_within_a_step_leaves_the_bristles_no_direction():
    """About the normal the bristles of both bodies cancel, about another axis the normals; rounding is no direction.
    At 179.999 degrees they keep their size, at 90 degrees to where they were."""
    z = np.array([3e-5, 0.0, 0.0])
    for axis, normals in ((UP, [UP, UP]), (np.array([1.0, 0.0, 0.0]), [UP, UP]), (UP, [UP, -UP])):
        turns = np.stack([spun(np.outer([0.0, np.pi], axis)), np.tile(np.eye(3), (2, 1, 1))], axis=1)
        assert not course(turns, np.array(normals), z)[-1].any()
    turns = np.stack([spun(np.outer([0.0, np.radians(179.999)], UP)), np.tile(np.eye(3), (2, 1, 1))], axis=1)
    assert course(turns, np.array([UP, UP]), z)[-1] == approx(3e-5 * np.array([0.0, 1.0, 0.0]), abs=1e-9)


def test_a_block_is_turned_as_a_tensor():
    rng = np.random.default_rng(5)
    axes, block, out = spun(rng.normal(size=3)), rng.normal(size=(3, 3)), np.ones((3, 3))
    add_turned(axes, block, 0.7, out)
    np.testing.assert_allclose(out, 1.0 + 0.7 * axes @ block @ axes.T, rtol=1e-12)
