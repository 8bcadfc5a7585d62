"""The anatomical fingertip and its filling with beams, compared with the closed shape and brute force."""

from functools import cache

import numpy as np
import pytest
from formulas import anatomy_volume
from pytest import approx

from palpate.physics.fingertip.anatomy import Anatomy
from palpate.physics.fingertip.beam_bundle import BundleState, step
from palpate.physics.fingertip.surfaces import FingertipError, FingertipSurfaces, cast, fill, plate_axes

SHAPE = Anatomy()
TIP = SHAPE.fingertip()


def dome_tip(radius, bone=3e-3):
    """A sphere with a spherical bone."""
    low, spacing = np.full(3, -12e-3), 4e-4
    n = 61
    grid = low + spacing * np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1)
    r = np.linalg.norm(grid, axis=-1)
    return FingertipSurfaces(low, np.full(3, spacing), r - radius, r - radius + 1e-3, r - bone)


def test_lines_through_a_sphere_have_the_exact_intersections_at_any_angle():
    tip = dome_tip(8e-3)
    x, y = np.meshgrid(np.linspace(-6e-3, 6e-3, 9), np.linspace(-6e-3, 6e-3, 7))
    for angle in (0.0, 0.4, 1.2):
        rays = cast(tip, x, y, angle)
        half = np.sqrt(64e-6 - x**2 - y**2, where=x**2 + y**2 < 64e-6, out=np.full_like(x, np.nan))
        assert rays.bottom == approx(-half, abs=2e-5, nan_ok=True) and rays.top == approx(half, abs=2e-5, nan_ok=True)
        bone = np.isfinite(rays.low)
        assert np.array_equal(bone, np.hypot(x, y) < 3e-3)
        assert rays.low[bone] == approx(-np.sqrt(9e-6 - (x**2 + y**2)[bone]), abs=2e-5)


def test_the_sampled_anatomy_has_the_volumes_of_the_closed_form():
    for name in ("skin", "tissue", "bone"):
        assert TIP.volume(name) == approx(anatomy_volume(SHAPE, name, SHAPE.length), rel=0.02)


def test_the_closed_surfaces_are_nested_and_their_level_approximates_the_distance():
    random = np.random.default_rng(0)
    points = random.uniform([-9e-3, 0, -9e-3], [9e-3, 25e-3, 7e-3], size=(4000, 3))
    skin, tissue, bone = (SHAPE.level(k, points) for k in ("skin", "tissue", "bone"))
    assert np.all(tissue[bone < 0] < 0) and np.all(skin[tissue < 0] < 0)
    near = (np.abs(skin) < 5e-4) & (points[:, 1] > 1e-3)
    moved = points[near] - skin[near, None] * numeric_normal(points[near])
    assert np.abs(SHAPE.level("skin", moved)).max() < 5e-5


def numeric_normal(points, h=1e-6):
    normal = np.stack(
        [SHAPE.level("skin", points + h * e) - SHAPE.level("skin", points - h * e) for e in np.eye(3)], -1
    )
    return normal / np.linalg.norm(normal, axis=1)[:, None]


@pytest.mark.parametrize("degrees", [0, 20, 45, 70])
def test_every_beam_spans_from_skin_to_nail_and_includes_its_bone(degrees):
    angle = np.radians(degrees)
    body = fill(TIP, 2e-3, angle=angle)
    assert body.heights.min() == approx(0, abs=1e-12) and body.heights.max() < 2e-3
    assert np.all(body.lengths >= 0) and np.all(body.lengths[:, 0] > 0.9e-3)
    assert 0.2 < (body.lengths[:, 2] > 0).mean() < 1.0
    axes = plate_axes(angle)
    assert axes @ axes.T == approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "degrees"), [(0, 0.012, 0), (1e-3, 0.009, 20), (-2e-3, 0.006, 45), (3e-3, 0.015, 10)]
)
def test_lines_cross_the_anatomy_where_brute_force_finds_the_borders(x, y, degrees):
    """March through the closed shape along a line, in steps of 2 µm."""
    axes = plate_axes(np.radians(degrees))
    z = np.arange(-15e-3, 25e-3, 2e-6)
    line = x * axes[0] + y * axes[1] + z[:, None] * axes[2]
    rays = cast(TIP, x, y, np.radians(degrees))
    skin, tissue, bone = (z[SHAPE.level(k, line) < 0] for k in ("skin", "tissue", "bone"))
    assert [rays.bottom, rays.top] == approx([skin[0], skin[-1]], abs=2e-5)
    assert rays.inner == approx(tissue[0], abs=2e-5)
    assert [rays.low, rays.high] == approx([bone[0], bone[-1]], abs=6e-5)


STRAIGHT = Anatomy(bulge=0.0, palmar=7.4e-3)
"""A pulp that is straight towards the hand, as deep as the default one at its bulge."""


@cache
def sampled(anatomy):
    return anatomy.fingertip()


@cache
def drawn_back(anatomy, degrees, dt=1e-2):
    """Contact area [m²], friction at gross slip [N], time until gross slip [s], and mu F_n / (k v) [s], 2 mm deep at
    2 mm/s."""
    body = fill(sampled(anatomy), 2e-3, pitch=0.8e-3, angle=np.radians(degrees))
    state = BundleState(body)
    for _ in range(40):
        force = step(body, state, 2e-3, (0, 0), 0.7, 1.0)
    touching = state.normal > 0
    expected, time = 0.7 * force[2] / (body.lateral[touching].sum() * 2e-3), 0.0
    while np.hypot(*force[:2]) < 0.99 * 0.7 * force[2] and time < 4:
        force, time = step(body, state, 2e-3, (0, 2e-3 * dt), 0.7, dt), time + dt
    return touching.sum() * body.cell, np.hypot(*force[:2]), time, expected


def test_a_smaller_angle_gives_more_contact_friction_and_stick_from_45_degrees_on():
    area, friction, stick, _ = np.array([drawn_back(SHAPE, degrees) for degrees in (45, 60, 75)]).T
    assert np.all(np.diff(area) < 0) and np.all(np.diff(friction) < 0) and np.all(np.diff(stick) < 0)


def test_contact_grows_at_small_angles_only_with_a_straight_pulp():
    """From 45° to 15° contact and friction grow by at least 20 % with the straight pulp, by less than 10 % with the
    other."""
    straight, bulging = (
        np.array([drawn_back(anatomy, degrees)[:2] for degrees in (0, 15, 45, 75)]) for anatomy in (STRAIGHT, SHAPE)
    )
    assert np.all(np.diff(straight, axis=0) < 0)
    assert np.all(straight[1] > 1.2 * straight[2]) and np.all(bulging[1] < 1.1 * bulging[2])


@pytest.mark.parametrize("anatomy", [SHAPE, STRAIGHT], ids=["bulging", "straight"])
@pytest.mark.parametrize("degrees", [15, 30, 45, 60, 75])
def test_the_stick_time_follows_the_mean_load_on_the_springs(anatomy, degrees):
    """The width of the contact cancels, because it is a factor of both force and stiffness."""
    _, _, time, expected = drawn_back(anatomy, degrees)
    assert time == approx(expected, rel=0.1)


def test_asymmetric_bone_shifts_the_pressure_under_a_symmetric_outline():
    centres = []
    for shift in (-1.5e-3, 0.0, 1.5e-3):
        body = fill(Anatomy(bone_shift=shift).fingertip(), 2e-3, angle=0.0)
        state = BundleState(body)
        for _ in range(50):
            step(body, state, 2e-3, (0, 0), 0.7, 1.0)
        centres.append((body.points[:, 0] * state.normal).sum() / state.normal.sum())
    assert centres[2] > centres[1] + 1e-4 > centres[0] + 2e-4


def test_the_modulus_of_the_bone_does_not_matter_in_the_anatomical_fingertip():
    from palpate.physics.materials.voigt import BONE, SKIN, TISSUE, ViscoelasticMaterial

    forces = []
    for factor in (0.1, 1.0, 10.0):
        bone = ViscoelasticMaterial(BONE.modulus * factor, 0.0)
        body = fill(TIP, 2e-3, angle=0.3, materials=(SKIN, TISSUE, bone, TISSUE))
        state = BundleState(body)
        seen = [step(body, state, d, (0, 0), 0.7, 1e-2) for d in np.linspace(0, 2e-3, 101)[1:]]
        seen += [step(body, state, 2e-3, (0, 2e-5), 0.7, 1e-2) for _ in range(50)]
        forces.append(np.array(seen))
    largest = np.linalg.norm(forces[1], axis=1).max()
    assert np.abs(forces[0] - forces[1]).max() < 1e-3 * largest > np.abs(forces[2] - forces[1]).max()


def test_saving_and_loading_preserves_every_number(tmp_path):
    TIP.save(tmp_path / "tip.npz")
    again = FingertipSurfaces.load(tmp_path / "tip.npz")
    for name in ("origin", "spacing", "skin", "tissue", "bone"):
        assert np.array_equal(getattr(again, name), getattr(TIP, name))


def test_a_file_without_a_fingertip_is_an_error(tmp_path):
    with pytest.raises(FingertipError, match="cannot be read"):
        FingertipSurfaces.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(FingertipError, match="cannot be read"):
        FingertipSurfaces.load(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", skin=np.zeros(3))
    with pytest.raises(FingertipError, match="no origin"):
        FingertipSurfaces.load(tmp_path / "other.npz")
    np.savez(tmp_path / "shape.npz", origin=np.zeros(3), spacing=np.ones(3), skin=np.zeros(3), tissue=np.zeros(3),
             bone=np.zeros(3))  # fmt: skip
    with pytest.raises(FingertipError, match="three axes"):
        FingertipSurfaces.load(tmp_path / "shape.npz")


@pytest.mark.parametrize(("field", "value"), [("spacing", 0.0), ("origin", np.inf), ("bone", np.nan)])
def test_a_file_with_one_number_that_is_none_is_an_error(tmp_path, field, value):
    numbers = {name: np.array(getattr(TIP, name)) for name in ("origin", "spacing", "skin", "tissue", "bone")}
    numbers[field].flat[1] = value
    np.savez(tmp_path / "tip.npz", **numbers)
    with pytest.raises(FingertipError, match="finite distances and spacing > 0"):
        FingertipSurfaces.load(tmp_path / "tip.npz")


@pytest.mark.parametrize(("depth", "pitch"), [(0.0, 1e-3), (1e-3, 0.0), (-1e-3, 1e-3), (np.inf, 1e-3)])
def test_a_filling_without_size_is_an_error(depth, pitch):
    with pytest.raises(FingertipError, match="> 0"):
        fill(TIP, depth, pitch)
