"""The stiffness map of a nodule: limits, trends, and its law on the axis compared with an integral over point loads."""

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import quad

from palpate.nodes.base.nodule import WithNodule
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.materials.nodule import nodule_centre, stiffness_map

MESH = surface_mesh("plane", 2500)
UP = np.array([[0.0, 0.0, 1.0]])


def above(depth, radius, ratio, reach, offset=0.0):
    """The factor at one vertex at the lateral distance `offset` from the nodule's centre."""
    return float(stiffness_map([[offset, 0.0, 0.0]], UP, [0.0, 0.0, -depth], radius, ratio, reach)[0])


def settled(z, reach):
    """Displacement on the axis at depth z under a uniform pressure on a disc, incompressible, by point loads."""

    def ring(s):
        distance = np.hypot(s, z)
        return 2 * np.pi * s * (1 + z**2 / distance**2) / distance if distance > 0 else 2 * np.pi

    return quad(ring, 0, reach, epsabs=1e-14)[0]


@pytest.mark.parametrize(("top", "bottom", "reach"), [(2e-3, 10e-3, 6e-3), (0.0, 3e-3, 4e-3), (8e-3, 9e-3, 5e-3)])
def test_the_share_of_a_column_equals_that_of_the_loaded_half_space(top, bottom, reach):
    share = (settled(top, reach) - settled(bottom, reach)) / settled(0.0, reach)
    stiffening = above((top + bottom) / 2, (bottom - top) / 2, 8.0, reach)
    assert 1 / stiffening == approx(1 - share * (1 - 1 / 8.0), rel=1e-6)


def test_a_nodule_with_the_tissues_modulus_or_not_below_changes_nothing():
    assert above(6e-3, 4e-3, 1.0, 6e-3) == 1.0
    assert above(6e-3, 4e-3, 50.0, 6e-3, offset=4.01e-3) == 1.0
    assert above(-6e-3, 4e-3, 50.0, 6e-3) == 1.0
    assert above(10.0, 4e-3, 50.0, 6e-3) == approx(1.0, abs=1e-4)


def test_the_surface_stiffens_with_ratio_and_size_and_softens_with_depth_and_distance():
    assert np.all(np.diff([above(6e-3, 4e-3, k, 6e-3) for k in (0.1, 0.5, 1, 2, 10, 1e6)]) > 0)
    assert np.all(np.diff([above(6e-3, r, 10, 6e-3) for r in (1e-3, 2e-3, 4e-3, 6e-3)]) > 0)
    assert np.all(np.diff([above(d, 4e-3, 10, 6e-3) for d in (6e-3, 8e-3, 12e-3, 20e-3)]) < 0)
    assert np.all(np.diff([above(6e-3, 4e-3, 10, 6e-3, x) for x in (0, 1e-3, 2e-3, 3e-3, 3.9e-3)]) < 0)


def test_the_map_is_positive_and_finite_for_any_nodule():
    stiffening = stiffness_map(MESH.vertices, MESH.normals, [0, 0, -1e-3], 30e-3, 1e12, 5e-3)
    assert np.isfinite(stiffening).all() and stiffening.min() >= 1.0


def test_the_centre_is_below_the_surface_along_its_normal():
    centre = nodule_centre(MESH.vertices, MESH.normals, [3.3e-3, -1e-3, 0.0], 6e-3)
    assert centre == approx([3.3e-3, -1e-3, -6e-3])


def test_the_map_follows_the_normal_of_a_tilted_surface():
    tilt = np.array([0.6, 0.0, 0.8])
    stiffening = stiffness_map([[0.0, 0.0, 0.0]], [tilt], -6e-3 * tilt, 4e-3, 10.0, 6e-3)
    assert stiffening[0] == approx(above(6e-3, 4e-3, 10.0, 6e-3))


@pytest.mark.parametrize("name", ["radius", "ratio", "reach"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_impossible_nodules_are_errors(name, value):
    given = {"radius": 4e-3, "ratio": 10.0, "reach": 6e-3} | {name: value}
    with pytest.raises(ValueError, match=f"{name}: found {value}, expected"):
        stiffness_map([[0, 0, 0]], UP, [0, 0, -6e-3], **given)


class Body(WithNodule):
    """A body with only a surface."""


FLAT = {"surface": "plane", "vertices": 2500, "position": (0.0, 0.0, 0.1)}


def test_a_body_takes_its_nodule_from_its_settings():
    node = Body(**FLAT, nodule_radius=4e-3, nodule_position=(2e-3, -1e-3, 0.1), nodule_ratio=7.0)
    vertices = MESH.vertices + [0, 0, 0.1]
    centre = [2e-3, -1e-3, 0.094]
    assert node.hardness() == approx(stiffness_map(vertices, MESH.normals, centre, 4e-3, 7.0, 6e-3))
    assert vertices[np.argmax(node.hardness())][:2] == approx([2e-3, -1e-3], abs=1.1e-3)


def test_a_body_without_a_nodule_is_homogeneous():
    assert np.all(Body(**FLAT).hardness() == 1)
