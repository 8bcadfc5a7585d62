"""From images to a fingertip, on a phantom of known shape."""

import dataclasses
import json
import sys

import numpy as np
import pytest
from formulas import anatomy_volume
from pytest import approx

pytest.importorskip("skimage")
pytest.importorskip("pydicom")
pytest.importorskip("nibabel")

import phantom_finger as phantom
from scan_images import coarse, write_images
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.scan import ScanError, read, rebuild, segment
from palpate.models.scan.outline import smooth
from palpate.models.scan.rebuild import reconstruct
from palpate.physics.fingertip.anatomy import Anatomy
from palpate.physics.fingertip.beam_bundle import BundleState, step
from palpate.physics.fingertip.surfaces import FingertipSurfaces, cast, fill

SHAPE = Anatomy()
START = -0.5e-3
SPACING = (1.2e-3, 0.23e-3, 0.23e-3)


def _long(*case):
    return pytest.param(*case, marks=pytest.mark.long)


def image_centre(anatomy):
    """Height z [m] of the middle of the images over the axis of the finger."""
    return (anatomy.dorsal - anatomy.palmar - anatomy.bulge) / 2


@pytest.fixture(scope="module")
def stack():
    return phantom.scan(start=START)


@pytest.fixture(scope="module")
def outlines(stack):
    return segment(stack)


@pytest.fixture(scope="module")
def rebuilt(outlines):
    return reconstruct(outlines)


@pytest.fixture(scope="module")
def tip(rebuilt):
    return rebuilt.tip


@pytest.fixture(scope="module")
def images(stack, tmp_path_factory):
    return write_images(stack, tmp_path_factory.mktemp("images") / "i.nii")


def in_anatomy(outlines, name):
    """Points of the outlines in the frame of the closed shape, by slice."""
    centre = image_centre(SHAPE)
    return {
        k: np.stack([c[:, 1], np.full(len(c), START + k * SPACING[0]), centre - c[:, 0]], axis=1)
        for k, c in enumerate(getattr(outlines, name))
        if c is not None
    }


@pytest.mark.parametrize(("name", "first"), [("skin", 2), ("tissue", 4), ("bone", 6)])
def test_outlines_agree_with_the_known_surface_to_0_2_pixels(outlines, name, first):
    """In slices that the surface crosses steeply; near its tip a slice of 1.2 mm averages over the slope."""
    for k, points in in_anatomy(outlines, name).items():
        if k >= first:
            error = np.abs(SHAPE.level(name, points))
            assert error.mean() < 0.2 * SPACING[1] * (1 if k > first + 1 else 2.5), (name, k)
            assert error.max() < SPACING[1] * (1 if k > first else 1.5)


def test_the_surfaces_have_the_known_volumes(tip):
    until = START + 22 * SPACING[0]
    for name, part in (("skin", 0.02), ("tissue", 0.02), ("bone", 0.04)):
        assert tip.volume(name) == approx(anatomy_volume(SHAPE, name, until), rel=part)


@pytest.mark.parametrize("degrees", [0, 20, 45])
def test_the_pulp_lies_where_it_should_also_between_slices(rebuilt, degrees):
    """Height of the skin over the plate against the closed shape, wherever 2 mm of depth would touch."""
    tip, frame = rebuilt
    grid = tip.origin + tip.spacing * np.moveaxis(np.indices(tip.skin.shape), 0, -1)
    there = grid @ frame.axes + frame.origin + [0, START, image_centre(SHAPE)]
    known = FingertipSurfaces(
        tip.origin, tip.spacing, *(SHAPE.level(name, there) for name in ("skin", "tissue", "bone"))
    )
    angle = np.radians(degrees)
    x, y = np.meshgrid(np.arange(-7e-3, 7e-3, 5e-4), np.arange(-8e-3, 26e-3, 5e-4))
    right, rays = cast(known, x, y, angle), cast(tip, x, y, angle)
    touches = right.bottom < np.nanmin(right.bottom) + 2e-3
    error = np.abs(rays.bottom - right.bottom)[touches]
    assert np.isfinite(error).all() and np.median(error) < 0.06e-3 and np.percentile(error, 95) < 0.25e-3


def test_the_force_is_that_of_the_known_shape(tip):
    forces = []
    for finger in (SHAPE.fingertip(), tip):
        body = fill(finger, 2e-3, pitch=0.6e-3, angle=np.radians(20))
        state = BundleState(body)
        for _ in range(30):
            force = step(body, state, 2e-3, (0, 0), 0.7, 1.0)
        forces.append(force[2])
    assert forces[1] == approx(forces[0], rel=0.05)


@pytest.mark.parametrize("kind", ["dicom", "nifti", "plain"])
def test_every_format_brings_the_same_images_back(tmp_path, kind):
    stack = coarse()
    if kind == "dicom":
        copy = read(phantom.write_dicom(stack, tmp_path / "d"))
    elif kind == "nifti":
        copy = read(phantom.write_nifti(stack, tmp_path / "v.nii.gz"))
    else:
        copy = read(write_images(stack, tmp_path / "i.nii"))
    assert copy.spacing == approx(stack.spacing)
    scale = 1.2 / phantom.FULL
    assert copy.volume * scale == approx(np.clip(stack.volume, 0, 1.2), abs=scale)


@pytest.mark.parametrize("seed", [1, _long(2)])
def test_noise_of_10_percent_of_the_tissue_is_tolerated(seed):
    segmented = segment(phantom.scan(noise=0.09, seed=seed, start=START))
    for k, points in in_anatomy(segmented, "skin").items():
        if k > 3:
            assert np.abs(SHAPE.level("skin", points)).mean() < 0.5 * SPACING[1]


def test_skin_as_bright_as_tissue_needs_its_thickness(stack, monkeypatch):
    monkeypatch.setitem(phantom.BRIGHTNESS, "skin", 0.9)
    plain = phantom.scan(start=START)
    with pytest.raises(ScanError, match="--skin"):
        segment(plain)
    rebuilt_tip = rebuild(segment(plain, skin=1.1e-3))
    rays = cast(rebuilt_tip, np.zeros(9), np.linspace(8e-3, 20e-3, 9))
    assert rays.inner - rays.bottom == approx(1.1e-3, abs=0.25e-3)


@pytest.mark.parametrize(
    ("shape", "light", "images"),
    [
        (Anatomy(width=0.013, palmar=0.0045, dorsal=0.0045, skin=0.0009), {}, {}),
        _long(Anatomy(width=0.020, palmar=0.0065, dorsal=0.0065, skin=0.0015, shaft=0.003), {}, {}),
        (SHAPE, {"skin": 0.6, "bone": 0.3}, {}),
        _long(SHAPE, {"skin": 0.3, "bone": 0.05}, {}),
        (SHAPE, {"air": 0.05, "skin": 0.5, "tissue": 1.0}, {"shading": 0.2, "noise": 0.06}),
        (SHAPE, {}, {"spacing": (2e-3, 0.4e-3, 0.3e-3), "pixels": 90, "slices": 14}),
        (SHAPE, {}, {"spacing": (0.8e-3, 0.18e-3, 0.18e-3), "pixels": 142, "slices": 33, "start": -3e-3}),
    ],
)
def test_other_fingers_contrasts_and_resolutions_are_read_as_well(monkeypatch, shape, light, images):
    for name, value in light.items():
        monkeypatch.setitem(phantom.BRIGHTNESS, name, value)
    stack = phantom.scan(shape, **{"start": START, **images})
    segmented = segment(stack)
    centre = image_centre(shape)
    for name in ("skin", "tissue", "bone"):
        errors = []
        for k, curve in enumerate(getattr(segmented, name)):
            if curve is not None:
                y = np.full(len(curve), images.get("start", START) + k * stack.spacing[0])
                points = np.stack([curve[:, 1], y, centre - curve[:, 0]], axis=1)
                errors.append(np.abs(shape.level(name, points)).mean())
        assert np.median(errors) < 0.15 * max(stack.spacing[1:])
    assert len(fill(rebuild(segmented), 2e-3).heights) > 60


def test_two_fingers_are_refused(stack):
    both = np.concatenate([stack.volume, stack.volume], axis=2)
    with pytest.raises(ScanError, match="more than one finger"):
        segment(dataclasses.replace(stack, volume=both))


def test_a_finger_without_bone_is_refused(monkeypatch):
    monkeypatch.setitem(phantom.BRIGHTNESS, "bone", 0.9)
    with pytest.raises(ScanError, match="no bone"):
        segment(phantom.scan())


def test_missing_slices_are_refused(stack, tmp_path):
    folder = phantom.write_dicom(coarse(), tmp_path / "d")
    (folder / "image_004.dcm").unlink()
    with pytest.raises(ScanError, match="slice is missing"):
        read(folder)
    gap = np.concatenate([stack.volume[:8], stack.volume[15:]])
    with pytest.raises(ScanError, match="missing"):
        segment(dataclasses.replace(stack, volume=np.concatenate([gap[:8], gap[:1] * 0 + 0.01, gap[8:]])))


@pytest.mark.parametrize(
    ("spacing", "text"),
    [
        ((1.2e-3, 0.23, 0.23), "row spacing"),
        ((0.0, 0.23e-3, 0.23e-3), "slice spacing"),
        ((1.2e-3, 0.9e-3, 0.9e-3), "mm across"),
        ((1.2e-3, 0.05e-3, 0.05e-3), "mm across|no bone|finger"),
        ((1.2e-3, 2.4e-3, 2.4e-3), "row spacing 2.4 mm, expected 0.02 ... 1 mm"),
    ],
)
def test_a_wrong_spacing_is_refused(images, spacing, text):
    with pytest.raises(ScanError, match=text):
        segment(read(images, spacing))


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda d: None, "no such file"),
        (lambda d: d.mkdir(), "no DICOM images in it"),
        (lambda d: d.write_text("x"), "not a stack"),
    ],
)
def test_a_file_that_is_not_a_scan_is_an_error(tmp_path, make, text):
    make(tmp_path / "scan")
    with pytest.raises(ScanError, match=text):
        read(tmp_path / "scan")


def test_broken_files_are_refused(tmp_path):
    (tmp_path / "bad.nii").write_bytes(b"not nifti")
    with pytest.raises(ScanError, match="cannot be read as NIfTI"):
        read(tmp_path / "bad.nii")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "slice_001.png").write_bytes(b"some image")
    with pytest.raises(ScanError, match="convert PNG or TIFF images to NIfTI"):
        read(tmp_path / "folder")


@pytest.mark.parametrize(
    ("shape", "text"),
    [
        ((0, 1, 1), "its header claims 0 voxels, expected 1 to 8"),
        ((1, 1, 1), "found 0 dimensions, expected one volume of three"),
        ((2, 2, 2), "expected 6 slices or more"),
        ((3, 3, 1), "its header claims 9 voxels, expected 1 to 8"),
    ],
)
def test_the_number_of_voxels_is_checked_from_one_to_its_limit(tmp_path, monkeypatch, shape, text):
    """One voxel, and as many as the limit, are refused for their shape, not for their number."""
    import nibabel

    monkeypatch.setattr(sys.modules["palpate.models.scan.read"], "MOST_VOXELS", 8)
    file = tmp_path / "few.nii"
    nibabel.save(nibabel.Nifti1Image(np.zeros(shape, np.int16), np.eye(4)), file)
    with pytest.raises(ScanError, match=text):
        read(file)


def test_the_slope_and_intercept_of_dicom_scale_the_voxels(tmp_path):
    import pydicom

    plain = read(phantom.write_dicom(coarse(), tmp_path / "d")).volume
    for path in (tmp_path / "d").iterdir():
        image = pydicom.dcmread(path)
        image.RescaleSlope, image.RescaleIntercept = "4", "-100"
        image.save_as(path)
    assert read(tmp_path / "d").volume == approx(4.0 * plain - 100.0)


def test_a_series_that_is_larger_than_any_scan_is_refused(tmp_path, monkeypatch):
    folder = phantom.write_dicom(coarse(), tmp_path / "d")
    size = sum(path.stat().st_size for path in folder.iterdir())
    monkeypatch.setattr(sys.modules["palpate.models.scan.read"], "MOST_FILE", size)
    read(folder)
    monkeypatch.setattr(sys.modules["palpate.models.scan.read"], "MOST_FILE", size - 1)
    with pytest.raises(ScanError, match=f"of {size} bytes together, expected at most {size - 1}"):
        read(folder)


def test_two_series_in_one_folder_are_refused(tmp_path):
    folder = phantom.write_dicom(coarse(), tmp_path / "d")
    other = phantom.write_dicom(coarse(), tmp_path / "e")
    (other / "image_001.dcm").rename(folder / "other.dcm")
    with pytest.raises(ScanError, match="2 series"):
        read(folder)


@pytest.mark.parametrize("fill_value", [0.0, 1.0])
def test_images_without_anything_are_refused(stack, fill_value):
    with pytest.raises(ScanError):
        segment(dataclasses.replace(stack, volume=np.full_like(stack.volume, fill_value)))
    noise = np.random.default_rng(0).normal(size=stack.volume.shape).astype(np.float32)
    with pytest.raises(ScanError):
        segment(dataclasses.replace(stack, volume=noise))


def test_smoothing_keeps_an_ellipse():
    t = np.linspace(0, 2 * np.pi, 400)
    curve = np.stack([3 * np.cos(t), 2 * np.sin(t)], axis=1)
    smoothed = smooth(curve)
    assert np.hypot(smoothed[:, 0] / 3, smoothed[:, 1] / 2) == approx(1, abs=2e-3)


def test_the_command_writes_the_fingertip_and_its_picture(stack, tmp_path):
    folder = phantom.write_dicom(stack, tmp_path / "d")
    result = CliRunner().invoke(app, ["build", "fingertip", str(folder), "-o", str(tmp_path / "finger.npz"), "--json"])
    assert result.exit_code == 0, result.output
    report = json.loads(result.output)
    assert report["slices"] == 23 and report["breadth_mm"] == approx(16, abs=0.6)
    assert report["skin_mm"] == approx(1.2, abs=0.3)
    assert FingertipSurfaces.load(tmp_path / "finger.npz").skin.min() < -4e-3
    assert (tmp_path / "finger.png").stat().st_size > 20_000


@pytest.mark.parametrize("extra", [True, False])
def test_the_command_reports_errors(extra, tmp_path, monkeypatch):
    if not extra:  # wrong input is reported first
        monkeypatch.setitem(sys.modules, "palpate.models.scan", None)
    result = CliRunner().invoke(app, ["build", "fingertip", str(tmp_path / "none")])
    assert result.exit_code == 2 and "no such file" in unwrapped(result.output)
    for options in (["--spacing", "1,2"], ["-o", "finger.txt"], ["--skin", "40"], ["-o", "nowhere/finger.npz"]):
        result = CliRunner().invoke(app, ["build", "fingertip", str(tmp_path), *options])
        assert result.exit_code == 2


@pytest.mark.parametrize("start", [-1.5e-3, _long(-0.5e-3), _long(0.3e-3), 1e-3])
def test_slices_of_2_4_mm_are_thick_not_missing(start):
    rebuilt_tip = rebuild(segment(phantom.scan(slices=12, spacing=(2.4e-3, 0.23e-3, 0.23e-3), start=start)))
    assert len(fill(rebuilt_tip, 2e-3).heights) > 60


def test_the_beams_of_the_picture_have_their_positions_in_the_finger():
    figure = pytest.importorskip("matplotlib.figure")
    from palpate.views.pictures.models.scan import _beams

    tip, depth, pitch = SHAPE.fingertip(), 2e-3, 1.2e-3
    axes = figure.Figure().add_subplot()
    _beams(axes, tip, depth, pitch)
    x, y = 1e-3 * np.array(axes.collections[0].get_offsets()).T
    bottom = cast(tip, x, y).bottom
    assert bottom - bottom.min() == approx(fill(tip, depth, pitch).heights, abs=2e-5)
    assert y.min() > 0.0  # the tip is at 0, as in the picture along the finger
