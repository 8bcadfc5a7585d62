"""The stiffness map of a nodule: its energy by other routes, limits of the law, trends."""

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import quad
from scipy.special import jv

from palpate.nodes.base.nodule import WithNodule
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.materials.nodule import WIDTH, energy_density, nodule_centre, region_map, stiffening, stiffness_map

MESH = surface_mesh("plane", 2500)
UP = np.array([[0.0, 0.0, 1.0]])


def above(depth, radius, ratio, reach, offset=0.0):
    """The factor at one vertex at the lateral distance `offset` from the nodule's centre."""
    return float(stiffness_map([[offset, 0.0, 0.0]], UP, [0.0, 0.0, -depth], radius, ratio, reach)[0])


def share(*given, **more):
    """Of the energy: with 3.5 times the modulus, k = 1 + w 2.5/(1 + (1 - w)) = (2 + 1.5 w)/(2 - w)."""
    factor = above(*given[:2], 3.5, *given[2:], **more)
    return 2.0 * (factor - 1.0) / (1.5 + factor)


def mean_displacement(transform):
    """2 G F² times the mean displacement under a pressure with this Hankel transform: 1/(2 pi) ∫ p(k)² dk."""
    return quad(lambda k: transform(k) ** 2, 0.0, np.inf, limit=200)[0] / (2.0 * np.pi)


def test_the_load_has_the_mean_displacement_of_the_kernel_that_spreads_it():
    """Transforms of (1 - r²)²: 48 J_3(k)/k³; of 3 a³/(2 pi (r² + a²)^{5/2}): (1 + a k) exp(-a k)."""
    kernel = mean_displacement(lambda k: 48.0 * jv(3, k) / k**3)
    bell = mean_displacement(lambda k: (1.0 + WIDTH * k) * np.exp(-WIDTH * k))
    assert bell == approx(5.0 / (8.0 * np.pi * WIDTH), rel=1e-9) and bell == approx(kernel, rel=1e-4)


@pytest.mark.parametrize(("r", "z"), [(0.0, 0.6), (0.8, 0.4), (2.0, 1.5)])
def test_the_energy_is_that_of_point_loads_on_an_incompressible_half_space(r, z):
    """Boussinesq: the stress of a point load is radial, -3 F z/(2 pi rho^5) x x. Twice its energy over the work."""
    a, node, weight = 0.7, *np.polynomial.legendre.leggauss(120)
    turn = (np.arange(240) + 0.5) * (2.0 * np.pi / 240)
    tangent = 0.25 * np.pi * (node + 1.0)  # s = 3 tan(t)
    s, ds = 3.0 * np.tan(tangent), 0.25 * np.pi * weight * 3.0 / np.cos(tangent) ** 2
    load = 3.0 * a**3 / (2.0 * np.pi * (s * s + a * a) ** 2.5) * s * ds
    x = np.stack(np.broadcast_arrays(r - s[:, None] * np.cos(turn), -s[:, None] * np.sin(turn), z), axis=-1)
    each = -3.0 * z / (2.0 * np.pi) / np.linalg.norm(x, axis=-1) ** 5 * load[:, None] * (2.0 * np.pi / 240)
    stress = np.einsum("sn,sni,snj->ij", each, x, x)
    deviator = stress - np.trace(stress) / 3.0 * np.eye(3)
    energy = np.sum(deviator**2) / 2.0  # 2 U times G
    work = 0.5 * mean_displacement(lambda k: (1.0 + a * k) * np.exp(-a * k))  # mean displacement times G, for F = 1
    assert energy_density(r * r, z, a) == approx(energy / work, rel=1e-6)


def test_the_energy_of_the_whole_half_space_is_the_work_of_the_load():
    """10 % of it lie farther than 8 times the reach, which the map ignores."""

    def within(limit):
        def layer(z):
            return quad(lambda r: 2.0 * np.pi * r * energy_density(r * r, z, WIDTH), 0.0, limit)[0]

        return quad(layer, 0.0, limit, epsrel=1e-7)[0]

    assert within(np.inf) == approx(1.0, rel=1e-6)
    assert share(50.0, 50.0, 6e-3) == approx(within(8.0), rel=1e-3)
    assert within(8.0) == approx(0.9, abs=0.02)


def test_the_law_has_the_limits_of_dilute_spheres_and_of_a_region_that_is_everything():
    """Rigid: 1 + 5 w/2 (Einstein). Empty: 1 - 5 w/3 (Mackenzie's cavities). First order: w times the excess."""
    for w in (1e-3, 1e-6):
        assert (stiffening(w, 1e12) - 1.0) / w == approx(2.5, rel=2e-3)
        assert (1.0 - stiffening(w, 1e-12)) / w == approx(5.0 / 3.0, rel=2e-3)
        assert (stiffening(w, 1.001) - 1.0) / w == approx(1e-3, rel=1e-3)
    for ratio in (0.1, 1.0, 10.0):
        assert stiffening(1.0, ratio) == approx(ratio) and stiffening(0.0, ratio) == 1.0


@pytest.mark.parametrize("ratio", [0.05, 0.5, 3.0, 100.0])
def test_the_law_lies_between_springs_in_series_and_in_parallel(ratio):
    w = np.linspace(0.01, 0.99, 50)
    factor = stiffening(w, ratio)
    assert (factor > 1.0 / (1.0 - w + w / ratio)).all() and (factor < 1.0 - w + w * ratio).all()


@pytest.mark.parametrize("radius, depth", [(4e-3, 6e-3), (6e-3, 5e-3), (9e-3, 9e-3), (1e-3, 1.5e-3)])
def test_the_energy_in_a_ball_equals_a_sum_over_small_cubes(radius, depth):
    """Also of balls that reach above the surface."""
    side = radius / 16.0
    grid = side * (np.arange(32) - 15.5)
    cubes = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    cubes = cubes[np.linalg.norm(cubes, axis=1) < radius] - [0.0, 0.0, depth]
    cubes = cubes[cubes[:, 2] < 0.0]
    for offset in (0.0, 4e-3, 15e-3):
        lateral = (cubes[:, 0] - offset) ** 2 + cubes[:, 1] ** 2
        width = WIDTH * 6e-3
        total = sum(energy_density(*each, width) for each in zip(lateral, -cubes[:, 2], strict=True)) * side**3
        assert share(depth, radius, 6e-3, offset=offset) == approx(total, rel=0.02)


def test_a_nodule_with_the_tissues_modulus_or_far_from_the_surface_changes_nothing():
    assert above(6e-3, 4e-3, 1.0, 6e-3) == 1.0
    assert above(6e-3, 4e-3, 50.0, 6e-3, offset=52.2e-3) == 1.0
    assert above(-6e-3, 4e-3, 50.0, 6e-3) == 1.0
    assert above(10.0, 4e-3, 50.0, 6e-3) == 1.0


def test_the_surface_stiffens_with_ratio_and_size_and_softens_with_depth_and_distance():
    assert np.all(np.diff([above(6e-3, 4e-3, k, 6e-3) for k in (0.1, 0.5, 1, 2, 10, 1e6)]) > 0)
    assert np.all(np.diff([above(6e-3, r, 10, 6e-3) for r in (1e-3, 2e-3, 4e-3, 6e-3)]) > 0)
    assert np.all(np.diff([above(d, 4e-3, 10, 6e-3) for d in (6e-3, 8e-3, 12e-3, 20e-3)]) < 0)
    assert np.all(np.diff([above(6e-3, 4e-3, 10, 6e-3, x) for x in (0, 2e-3, 4e-3, 8e-3, 21e-3, 23e-3, 45e-3)]) < 0)


def test_lengths_scale():
    assert above(9e-3, 5e-3, 8.0, 6e-3, 3e-3) == approx(above(9.0, 5.0, 8.0, 6.0, 3.0), rel=1e-12)


def test_the_map_is_positive_and_finite_for_any_nodule():
    for ratio in (1e12, 1e-12):
        factor = stiffness_map(MESH.vertices, MESH.normals, [0, 0, -1e-3], 30e-3, ratio, 5e-3)
        assert np.isfinite(factor).all() and (factor > 0.0).all()


def test_points_without_volume_change_nothing():
    assert (region_map(MESH.vertices, MESH.normals, np.zeros((0, 3)), np.zeros(0), 9.0, 5e-3) == 1.0).all()


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


@pytest.mark.parametrize("patch", [4e-3, 12e-3])
def test_the_reach_of_the_map_follows_the_patch(patch):
    """Surface and ball in another scale, in proportion to the patch, have the same map."""
    given = FLAT | {"nodule_position": (0.0, 0.0, 0.1), "nodule_ratio": 7.0}
    node = Body(**given, radius=patch, nodule_radius=0.5 * patch, nodule_depth=0.75 * patch)
    vertices = (node.mesh().vertices - [0.0, 0.0, 0.1]) * (8e-3 / patch)
    assert node.hardness() == approx(stiffness_map(vertices, MESH.normals, [0, 0, -6e-3], 4e-3, 7.0, 6e-3), rel=1e-6)
    fixed = Body(**given, radius=patch, nodule_radius=4e-3, nodule_depth=6e-3, nodule_reach=6e-3)
    usual = Body(**given, nodule_radius=4e-3, nodule_depth=6e-3)
    assert fixed.hardness() == approx(usual.hardness(), rel=1e-12)


def test_a_body_without_a_nodule_is_homogeneous():
    assert np.all(Body(**FLAT).hardness() == 1)
