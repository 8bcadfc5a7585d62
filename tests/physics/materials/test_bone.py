"""Stiffness above bone: a layer on a rigid base by its exact solution, shadows, and invariance."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import jv

from palpate.physics.materials.bone import MOST, bone_map
from palpate.physics.segmentation.region import Region

REACH = 8e-3
UP = np.array([[0.0, 0.0, 1.0]])


def layer(depth):
    """Stiffness of an incompressible layer on a rigid base under (1 - r²)², over that of a half-space; depth in units
    of the radius (Burmister 1945)."""

    def squared(k):
        return (48.0 * jv(3, k) / k**3) ** 2 if k > 1e-3 else 1.0

    def softer(x):
        return (np.sinh(2 * x) - 2 * x) / (np.cosh(2 * x) + 1 + 2 * x * x) if x < 20 else 1.0

    whole, found = (
        quad(lambda k, f=f: squared(k) * f(k * depth), 1e-6, 60, limit=400)[0] for f in (lambda x: 1.0, softer)
    )
    return whole / found


def plate(depth, thick=2, sides=(1e-3, 1e-3, 1e-3), wide=0.2):
    """A plate of bone whose upper side is `depth` [m] below the plane z = 0."""
    count = [int(wide / sides[0]), int(wide / sides[1])]
    begin = [-0.5 * (count[0] - 1) * sides[0], -0.5 * (count[1] - 1) * sides[1], -depth - (thick - 0.5) * sides[2]]
    return Region(np.ones((*count, thick), bool), np.column_stack([np.diag(sides), begin]))


def factor(bone, at=(0.0, 0.0, 0.0), normal=UP, reach=REACH):
    return float(bone_map(np.array([at], float), np.array(normal, float), bone, reach)[0])


@pytest.mark.parametrize("share", [0.25, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("sides", [(1e-3, 1e-3, 1e-3), (0.8e-3, 0.8e-3, 2.5e-3)])
def test_a_layer_on_a_rigid_base_is_as_stiff_as_its_exact_solution(share, sides):
    assert factor(plate(share * REACH, sides=sides)) == pytest.approx(min(layer(share), MOST), rel=0.05)


def test_the_exact_solution_has_its_limits():
    """Far: a half-space. Near: thin incompressible layers are stiff as (R/h)³, by the equation of lubrication."""
    assert layer(100.0) == pytest.approx(1.0, abs=0.01)
    assert layer(0.05) / layer(0.1) == pytest.approx(8.0, rel=0.15)


def test_bone_shields_what_lies_behind_it():
    thin, thick = factor(plate(8e-3, 1)), factor(plate(8e-3, 20))
    assert thin == pytest.approx(thick, rel=0.01) and thin > 2.3


def test_half_a_plate_has_half_of_the_share():
    whole = plate(8e-3)
    half = Region(whole.voxels.copy(), whole.affine)
    half.voxels[: len(half.voxels) // 2] = False
    share = [1.0 - factor(bone) ** -0.75 for bone in (whole, half)]
    assert share[1] / share[0] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_and_scaled_organ_has_the_same_map(seed):
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shift, scale = rng.normal(size=3), float(rng.uniform(0.5, 2.0))
    bone = plate(6e-3, wide=0.1)
    bone.voxels[: rng.integers(40, 52), rng.integers(30, 45) :] = False
    places = np.array([(0.0, 0.0, 0.0), (4e-3, 2e-3, 1e-3), (0.0, 9e-3, 0.5e-3)])
    normals = np.tile(UP, (3, 1))
    affine = np.column_stack([scale * turn @ bone.affine[:, :3], scale * turn @ bone.affine[:, 3] + shift])
    found = bone_map(scale * places @ turn.T + shift, normals @ turn.T, Region(bone.voxels, affine), scale * REACH)
    np.testing.assert_allclose(found, bone_map(places, normals, bone, REACH), rtol=0.04)


def test_nearer_bone_is_stiffer_and_bone_above_or_far_has_no_effect():
    found = [factor(plate(depth)) for depth in np.linspace(1e-3, 50e-3, 30)]
    assert (np.diff(found) <= 1e-9).all() and found[0] == pytest.approx(MOST) and found[-1] < 1.1
    assert factor(plate(5e-3), normal=-UP) == 1.0 and factor(plate(70e-3, wide=0.02)) == 1.0
    assert factor(plate(0.0), at=(0.0, 0.0, -0.5e-3)) == pytest.approx(MOST)  # a surface in the bone


def test_the_map_of_the_same_organ_and_bone_is_computed_once():
    """All lanes of an ensemble have it; each took 0.9 s."""
    given = [(np.zeros((1, 3)), UP, plate(7e-3), REACH) for _ in range(2)]
    assert bone_map(*given[0]) is bone_map(*given[1])
    assert bone_map(*given[0][:2], plate(9e-3), REACH)[0] < bone_map(*given[0])[0]
