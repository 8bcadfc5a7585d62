"""The axes of the patch of `tactile.Stress` turn with the normal, without a jump."""

import itertools

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.nodes.tactile.stress import Stress
from palpate.physics.contact.subsurface import along_patch, first_axis, next_axis

Z = (0.0, 0.0, 1.0)


def turned(path, axis=(0.0, 0.0, 0.0)):
    """The axis at each of the normals (n,3), from the first on."""
    axes, before = [], tuple(path[0])
    for normal in path:
        axis = next_axis(tuple(axis), before, tuple(normal))
        axes.append(axis)
        before = tuple(normal)
    return np.array(axes)


def arc(a, b, n=200):
    """Normals on the great circle from a to b, perpendicular unit vectors."""
    t = np.linspace(0.0, np.pi / 2, n)[:, None]
    return np.cos(t) * np.array(a) + np.sin(t) * np.array(b)


@pytest.mark.parametrize("seed", range(20))
def test_the_axis_stays_a_unit_tangent_and_turns_no_faster_than_the_normal(seed):
    random = np.random.default_rng(seed)
    corners = random.normal(size=(6, 3))
    path = np.concatenate([a + np.linspace(0, 1, 300)[:, None] * (b - a) for a, b in itertools.pairwise(corners)])
    path /= np.linalg.norm(path, axis=1)[:, None]
    axes = turned(path)
    assert np.abs(np.sum(axes * path, axis=1)).max() < 1e-12
    assert np.linalg.norm(axes, axis=1) == approx(1.0, abs=1e-12)
    # the smallest rotation moves no vector farther than the normal
    moved, steps = (np.linalg.norm(np.diff(rows, axis=0), axis=1) for rows in (axes, path))
    assert np.all(moved <= steps + 1e-12)


def test_a_closed_path_turns_the_axis_by_the_solid_angle_that_it_encloses():
    """Gauss and Bonnet: an octant of the sphere has pi/2."""
    x, y, z = np.eye(3)
    axes = turned(np.concatenate([arc(z, x), arc(x, y), arc(y, z)]))
    assert axes[-1] == approx(np.cross(z, axes[0]), abs=1e-10)
    assert turned(np.concatenate([arc(z, x), arc(x, z)]))[-1] == approx(axes[0], abs=1e-10)


def test_a_normal_that_does_not_turn_keeps_the_first_axis_bit_for_bit():
    n = (0.6, 0.0, 0.8)
    assert next_axis(first_axis(n), n, n) == first_axis(n) == approx((0.8, 0.0, -0.6))
    assert first_axis((1.0, 0.0, 0.0)) == (0.0, 1.0, 0.0)


def test_a_load_that_turns_with_the_surface_leaves_the_stress_as_it_is():
    """1 N and 0.4 N of shear while the normal turns by 90 degrees, from z to x: no receptor feels a change."""
    bus = FakeBus(Stress(depths=(1e-3,), reach=4e-3))
    first = None
    for angle in np.linspace(0.0, np.pi / 2, 91):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        force = turn @ np.array([0.3, np.sqrt(0.16 - 0.09), -1.0])
        load = Load(nodes=np.zeros(1, "<i4"), forces=force[None], foot=(0, 0, 0), normal=tuple(turn @ np.array(Z)))
        stress = bus.publish(load)[0].stress.copy()
        first = stress if first is None else first
        assert stress == approx(first, abs=1e-9 * np.abs(first).max())


def test_the_force_is_resolved_along_the_axes_of_the_patch():
    found = along_patch(np.array([[1.0, 2.0, -3.0], [0.5, 0.0, 0.0]]), Z, (0.0, 1.0, 0.0))
    assert found == approx((2.0, 1.5, 3.0))
