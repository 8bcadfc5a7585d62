"""A layered finger from measured surfaces: beside the closed form, from images, and what is refused."""

import dataclasses

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe.element.elements import POINTS, gradients
from palpate.models.fe.element.mesh import MeshError
from palpate.models.fe.meshing.fingertip import FingertipDimensions
from palpate.models.fe.meshing.layers import BONE, DERMIS, EPIDERMIS, NAIL, SUBCUTIS
from palpate.models.fe.meshing.scanned import Scanned, bone_axis
from palpate.models.fe.study.press_record import record
from palpate.models.fe.study.pressing import Pressing
from palpate.physics.fingertip import surfaces as measured
from palpate.physics.fingertip.anatomy import Anatomy

RADII = {"bone": 6e-3, "tissue": 8.5e-3, "skin": 9.84e-3}
"""The paper's capsules."""


class Capsules(Anatomy):
    """The paper's finger: cylinders with hemispherical ends, about one axis."""

    def axes(self, name, y):
        r = RADII[name]
        one = np.ones_like(np.asarray(y, float))
        return r * one, r * one, r * one, RADII["skin"] - r, r


CAPSULES = Capsules(
    width=19.68e-3,
    palmar=9.84e-3,
    bulge=0.0,
    dorsal=9.84e-3,
    cap=9.84e-3,
    length=24e-3,
    bone_height=0.0,
    bone_shift=0.0,
)


def volumes(finger):
    _, det = gradients(finger.mesh.points, finger.mesh.elements, POINTS)
    layers = np.array([det[finger.mesh.region == k].sum() / 24 for k in (BONE, SUBCUTIS, DERMIS, EPIDERMIS, NAIL)])
    return layers if finger.whole else 2 * layers


def radius_errors(finger, start):
    """Distance of the meshed surfaces from the capsules [m], whose tip is at y = start."""
    lattice = finger._meshed[1]
    for name, shell in (("bone", 1.0), ("skin", 4.0)):
        place = finger._local(lattice[np.abs(lattice[:, 3] - shell) < 1e-9]) - [0, start + RADII["skin"], 0]
        yield (
            np.linalg.norm(np.column_stack([place[:, 0], np.minimum(place[:, 1], 0), place[:, 2]]), axis=1)
            - RADII[name]
        )


START = -0.5e-3
"""[m] Of the first slice, from the tip."""


@pytest.fixture(scope="module")
def sampled():
    return CAPSULES.fingertip()


@pytest.fixture(scope="module")
def imaged():
    """The capsules as an image stack, read back."""
    pytest.importorskip("skimage")
    from palpate.models.scan import phantom, segment
    from palpate.models.scan.rebuild import reconstruct

    spacing = (1.2e-3, 0.23e-3, 0.23e-3)
    stack = phantom.scan(CAPSULES, slices=20, spacing=spacing, pixels=108, start=START)
    return reconstruct(segment(stack), dorsal="up")


def before(imaged):
    """From where the finger was found to begin to the capsules' tip [m]."""
    return -START - imaged.frame.origin[1]


def test_the_axis_of_the_bone_is_found(sampled):
    axis = bone_axis(sampled, 12e-3)
    assert axis.at(np.array([5e-3, 20e-3]))[:, [0, 2]] == approx(0.0, abs=5e-5)
    assert axis.centre == approx(RADII["skin"], abs=1e-4)
    assert axis.length == approx(12e-3)
    short = dataclasses.replace(sampled, bone=np.maximum(sampled.bone, joint(sampled, 18e-3)))
    assert bone_axis(short, 12e-3).length == approx(18e-3 - RADII["skin"], abs=1.5 * sampled.spacing[1])
    with pytest.raises(MeshError, match="5 mm or more"):
        bone_axis(dataclasses.replace(sampled, bone=np.maximum(sampled.bone, joint(sampled, 13e-3))), 12e-3)
    bent = bone_axis(Anatomy(bone_shift=1e-3).fingertip(), 12e-3)
    assert bent.at(np.array([10e-3]))[0, 0] == approx(1e-3, abs=1e-4)


def joint(tip, y):
    """Distance to a plane across the finger, behind which there is no bone."""
    return (tip.origin[1] + tip.spacing[1] * np.arange(tip.bone.shape[1]) - y)[None, :, None]


@pytest.mark.parametrize("cells", [3, pytest.param(5, marks=pytest.mark.long)])
def test_surfaces_sampled_from_the_capsules_give_the_capsules_volumes(sampled, cells):
    """Of the closed form, one layer after another; the grid's share of the error is what finer elements leave."""
    meshed = Scanned(sampled, cells=cells)
    length = meshed._axis.length + meshed._axis.centre - RADII["skin"]
    right = volumes(FingertipDimensions(phalanx=length, cells=cells))
    assert volumes(meshed) == approx(right, rel=5e-3)
    assert (meshed.mesh.corner_volumes > 0).all()
    assert meshed.mesh.points[:, 2].min() == approx(0.0, abs=3e-5)


def test_volumes_converge_with_the_grid():
    coarse, fine = (Scanned(CAPSULES.fingertip(h), cells=4) for h in (8e-4, 3e-4))
    errors = []
    for meshed in (coarse, fine):
        length = meshed._axis.length + meshed._axis.centre - RADII["skin"]
        errors.append(np.abs(volumes(meshed) / volumes(FingertipDimensions(phalanx=length, cells=4)) - 1).max())
    assert errors[1] < 2e-3 and errors[1] < 0.5 * errors[0]


def test_surfaces_read_from_images_lie_within_a_tenth_of_a_millimetre(imaged):
    """Pixels of 0.23 mm, slices of 1.2 mm."""
    for error in radius_errors(Scanned(imaged.tip, cells=3), before(imaged)):
        assert np.abs(error).mean() < 4e-5 and np.abs(error).max() < 2e-4


@pytest.mark.long
def test_the_imaged_capsules_are_as_stiff_as_the_parametric_finger(imaged):
    scanned = Scanned(imaged.tip, cells=3)
    length = scanned._axis.length + scanned._axis.centre - before(imaged) - RADII["skin"]
    right = record(Pressing(FingertipDimensions(cells=3, phalanx=length), "steel", "cortical/36.4"), 6e-4)
    curve = record(Pressing(scanned, "steel", "cortical/36.4"), 6e-4)
    assert curve.force[-1] == approx(right.force[-1], rel=0.05)
    assert np.interp(right.force[-1], curve.force, curve.indentation) == approx(6e-4, abs=3e-5)


def test_a_finger_is_meshed_as_it_is_bent_and_one_sided():
    """The made-up anatomy: its bone lies to a side, so the mesh must not be symmetric."""
    meshed = Scanned(Anatomy(bone_shift=1e-3).fingertip(), cells=3)
    mesh = meshed.mesh
    assert (mesh.corner_volumes > 0).all() and not meshed.cut.any()
    assert len(meshed.pad) > 50 and meshed.held.any() and meshed.rear.sum() > 50
    lattice = meshed._meshed[1]
    for name, shell in (("bone", 1.0), ("skin", 4.0)):
        place = meshed._local(lattice[np.abs(lattice[:, 3] - shell) < 1e-9])
        assert np.abs(Anatomy(bone_shift=1e-3).level(name, place)).max() < 1e-4


@pytest.mark.parametrize(
    ("anatomy", "text"),
    [
        ({"bone_height": 2.2e-3}, "between skin and bone"),
        ({"bone_height": -7.5e-3, "bone_depth": 1e-3}, "skin .* axis lies outside"),
        ({"bone_start": 24e-3}, "rounded tip"),
        ({"bone_start": 60e-3}, "no bone"),
        ({"shaft": 6e-3}, "skin and bone|within the images"),
    ],
)
def test_a_bone_that_does_not_fit_is_refused(anatomy, text):
    with pytest.raises(MeshError, match=text):
        _ = Scanned(Anatomy(**anatomy).fingertip(), cells=3).mesh


def test_a_skin_that_is_cut_or_folded_is_refused():
    whole = Anatomy().fingertip()
    cut = dataclasses.replace(whole, skin=np.where(whole.skin > 0, -1e-4, whole.skin))
    with pytest.raises(MeshError, match="does not end within the images"):
        _ = Scanned(cut, cells=3).mesh
    far = np.argmin(np.abs(whole.origin[2] + whole.spacing[2] * np.arange(whole.skin.shape[2]) + 8.8e-3))
    bump = whole.skin.copy()
    bump[:, :, far] = -2e-4
    with pytest.raises(MeshError, match="folds back"):
        _ = Scanned(dataclasses.replace(whole, skin=bump), cells=3).mesh
    for wrong in ({"cells": 2}, {"tilt": 1.0}, {"dermis": np.nan}, {"phalanx": 0.0}):
        with pytest.raises(MeshError):
            Scanned(whole, **wrong)


def test_another_finger_has_another_digest(tmp_path):
    first, other = Anatomy().fingertip(), Anatomy(width=17e-3).fingertip()
    assert Scanned(first).describe() != Scanned(other).describe()
    first.save(tmp_path / "finger.npz")
    assert Scanned(measured.FingertipSurfaces.load(tmp_path / "finger.npz")).describe() == Scanned(first).describe()
